//! The models that can be fitted, and the numbers that a fit searches.

use super::Lobe;

/// The models that can be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// Diffuse alone.
    Lambert,
    /// See [`Lobe::BlinnPhong`].
    BlinnPhong,
    /// See [`Lobe::CookTorranceBeckmann`].
    CookTorranceBeckmann,
    /// See [`Lobe::CookTorranceGgx`].
    CookTorranceGgx,
    /// See [`Lobe::Ward`].
    Ward,
    /// See [`Lobe::AshikhminShirley`], with one exponent.
    AshikhminShirley,
    /// See [`Lobe::Lafortune`].
    Lafortune,
    /// See [`Lobe::WardAnisotropic`]; to an isotropic table it fits two equal widths.
    WardAnisotropic,
    /// See [`Lobe::AshikhminShirley`], with two exponents.
    AshikhminShirleyAnisotropic,
}

impl Form {
    /// Those that a turn of the surface does not change.
    pub const ISOTROPIC: [Form; 7] = [
        Form::Lambert,
        Form::BlinnPhong,
        Form::CookTorranceBeckmann,
        Form::CookTorranceGgx,
        Form::Ward,
        Form::AshikhminShirley,
        Form::Lafortune,
    ];

    /// All of them.
    pub const ALL: [Form; 9] = {
        let [a, b, c, d, e, f, g] = Form::ISOTROPIC;
        [a, b, c, d, e, f, g, Form::WardAnisotropic, Form::AshikhminShirleyAnisotropic]
    };

    /// Its name: the lobe's, but that the anisotropic form of Ashikhmin and Shirley has one of its own.
    pub fn name(self) -> &'static str {
        match self {
            Form::AshikhminShirleyAnisotropic => "ashikhmin-shirley-anisotropic",
            _ => self.lobe(&[0.0; 3]).name(),
        }
    }

    /// Whether it has two widths.
    pub fn is_anisotropic(self) -> bool {
        matches!(self, Form::WardAnisotropic | Form::AshikhminShirleyAnisotropic)
    }

    /// The form of a name.
    pub fn of_name(name: &str) -> Option<Self> {
        Form::ALL.into_iter().find(|form| form.name() == name)
    }

    /// The lobe of three numbers on the whole line: logarithm of the width, a second one where there is one, and the logarithm of the
    /// ratio between the widths along the two axes.
    pub(super) fn lobe(self, shape: &[f64; 3]) -> Lobe {
        let roughness = shape[0].exp();
        let widths = [0.5, -0.5].map(|half| (shape[0] + half * shape[2]).exp());
        // A Gaussian of slopes and a power of the cosine with the same curvature at the top.
        let exponent_of = |width: f64| 2.0 / (width * width);
        let exponent = exponent_of(roughness);
        let reflectance = 1.0 / (1.0 + (-shape[1]).exp());
        match self {
            Form::Lambert => Lobe::Lambert,
            Form::BlinnPhong => Lobe::BlinnPhong { exponent },
            Form::CookTorranceBeckmann => Lobe::CookTorranceBeckmann { roughness, reflectance },
            Form::CookTorranceGgx => Lobe::CookTorranceGgx { roughness, reflectance },
            Form::Ward => Lobe::Ward { roughness },
            Form::AshikhminShirley => Lobe::AshikhminShirley { exponents: [exponent; 2], reflectance },
            Form::WardAnisotropic => Lobe::WardAnisotropic { roughness: widths },
            Form::AshikhminShirleyAnisotropic => {
                Lobe::AshikhminShirley { exponents: widths.map(exponent_of), reflectance }
            }
            Form::Lafortune => Lobe::Lafortune { xy: -1.0, z: shape[1].exp(), exponent: 0.25 * exponent },
        }
    }

    /// Where the second number starts, and its range.
    pub(super) fn second(self) -> (f64, (f64, f64)) {
        match self {
            Form::Lafortune => (0.0, (-1.0, 1.0)),
            Form::CookTorranceBeckmann
            | Form::CookTorranceGgx
            | Form::AshikhminShirley
            | Form::AshikhminShirleyAnisotropic => (-2.0, (-6.0, 6.0)),
            _ => (0.0, (0.0, 0.0)),
        }
    }
}

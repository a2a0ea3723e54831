//! The models that can be fitted, and the numbers that a fit searches.

use super::ClassicalLobe;

/// The models that can be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClassicalForm {
    /// Diffuse alone.
    Lambert,
    /// See [`ClassicalLobe::BlinnPhong`].
    BlinnPhong,
    /// See [`ClassicalLobe::CookTorranceBeckmann`].
    CookTorranceBeckmann,
    /// See [`ClassicalLobe::CookTorranceGgx`].
    CookTorranceGgx,
    /// See [`ClassicalLobe::Ward`].
    Ward,
    /// See [`ClassicalLobe::AshikhminShirley`], with one exponent.
    AshikhminShirley,
    /// See [`ClassicalLobe::Lafortune`].
    Lafortune,
    /// See [`ClassicalLobe::WardAnisotropic`]; to an isotropic table it fits two equal widths.
    WardAnisotropic,
    /// See [`ClassicalLobe::AshikhminShirley`], with two exponents.
    AshikhminShirleyAnisotropic,
}

impl ClassicalForm {
    /// Those that a turn of the surface does not change.
    pub const ISOTROPIC: [ClassicalForm; 7] = [
        ClassicalForm::Lambert,
        ClassicalForm::BlinnPhong,
        ClassicalForm::CookTorranceBeckmann,
        ClassicalForm::CookTorranceGgx,
        ClassicalForm::Ward,
        ClassicalForm::AshikhminShirley,
        ClassicalForm::Lafortune,
    ];

    /// All of them.
    pub const ALL: [ClassicalForm; 9] = {
        let [a, b, c, d, e, f, g] = ClassicalForm::ISOTROPIC;
        [a, b, c, d, e, f, g, ClassicalForm::WardAnisotropic, ClassicalForm::AshikhminShirleyAnisotropic]
    };

    /// Returns the form's name: the lobe's, except for the anisotropic form of Ashikhmin and Shirley.
    pub fn name(self) -> &'static str {
        match self {
            ClassicalForm::AshikhminShirleyAnisotropic => "ashikhmin-shirley-anisotropic",
            _ => self.lobe(&[0.0; 3]).name(),
        }
    }

    /// Returns `true` for forms with two widths.
    pub fn is_anisotropic(self) -> bool {
        matches!(self, ClassicalForm::WardAnisotropic | ClassicalForm::AshikhminShirleyAnisotropic)
    }

    /// Returns the number of values that a fit takes at least: as many as the form has numbers, each colour of a value being one.
    pub fn min_samples(self) -> usize {
        match self {
            ClassicalForm::Lambert => 1,
            _ if self.is_anisotropic() => 16,
            _ => 8,
        }
    }

    /// The form of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        ClassicalForm::ALL.into_iter().find(|form| form.name() == name)
    }

    /// The lobe of three numbers on the whole line: logarithm of the width, a second one where there is one, and the logarithm of the
    /// ratio between the widths along the two axes.
    pub(super) fn lobe(self, shape: &[f64; 3]) -> ClassicalLobe {
        let roughness = shape[0].exp();
        let widths = [0.5, -0.5].map(|half| (shape[0] + half * shape[2]).exp());
        // A Gaussian of slopes and a power of the cosine with the same curvature at the top.
        let exponent_of = |width: f64| 2.0 / (width * width);
        let exponent = exponent_of(roughness);
        let reflectance = 1.0 / (1.0 + (-shape[1]).exp());
        match self {
            ClassicalForm::Lambert => ClassicalLobe::Lambert,
            ClassicalForm::BlinnPhong => ClassicalLobe::BlinnPhong { exponent },
            ClassicalForm::CookTorranceBeckmann => ClassicalLobe::CookTorranceBeckmann { roughness, reflectance },
            ClassicalForm::CookTorranceGgx => ClassicalLobe::CookTorranceGgx { roughness, reflectance },
            ClassicalForm::Ward => ClassicalLobe::Ward { roughness },
            ClassicalForm::AshikhminShirley => {
                ClassicalLobe::AshikhminShirley { exponents: [exponent; 2], reflectance }
            }
            ClassicalForm::WardAnisotropic => ClassicalLobe::WardAnisotropic { roughness: widths },
            ClassicalForm::AshikhminShirleyAnisotropic => {
                ClassicalLobe::AshikhminShirley { exponents: widths.map(exponent_of), reflectance }
            }
            ClassicalForm::Lafortune => {
                ClassicalLobe::Lafortune { xy: -1.0, z: shape[1].exp(), exponent: 0.25 * exponent }
            }
        }
    }

    /// Returns start and range of the second number.
    pub(super) fn second(self) -> (f64, (f64, f64)) {
        match self {
            ClassicalForm::Lafortune => (0.0, (-1.0, 1.0)),
            ClassicalForm::CookTorranceBeckmann
            | ClassicalForm::CookTorranceGgx
            | ClassicalForm::AshikhminShirley
            | ClassicalForm::AshikhminShirleyAnisotropic => (-2.0, (-6.0, 6.0)),
            _ => (0.0, (0.0, 0.0)),
        }
    }
}

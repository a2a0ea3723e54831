//! Fits a measured material in three forms and prints how far each is from it: `fit_merl [TABLE.binary]`.

use std::error::Error;
use tsuya::brdf::{
    BrdfForm, ClassicalForm, ClassicalLobe, ClassicalModel, FitSettings, MerlTable, fit_table, log_rmse,
};
use tsuya::input::FileAccess;

/// A table made of a known model, for want of a measured one.
pub fn made_up_table() -> MerlTable {
    let lobe = ClassicalLobe::CookTorranceGgx { roughness: 0.2, reflectance: 0.4 };
    MerlTable::tabulate(&ClassicalModel { diffuse: [0.3, 0.2, 0.1], specular: [0.5; 3], lobe })
}

/// Fits a table in each form: name, bytes, and root mean square error of `ln(1 + f cos)`.
pub fn run(table: &MerlTable) -> Result<Vec<(&'static str, usize, f64)>, Box<dyn Error>> {
    let mut fits = Vec::new();
    for form in [BrdfForm::Compact, BrdfForm::Dsbrdf, BrdfForm::Classical(ClassicalForm::CookTorranceGgx)] {
        let fitted = fit_table(table, form, &FitSettings::default())?;
        fits.push((form.name(), fitted.bytes(), log_rmse(table, &fitted)));
    }
    Ok(fits)
}

fn main() -> Result<(), Box<dyn Error>> {
    let table = match std::env::args().nth(1) {
        Some(path) => MerlTable::read(path, &FileAccess::default())?,
        None => made_up_table(),
    };
    for (name, bytes, error) in run(&table)? {
        println!("{name:18} {bytes:4} bytes, log RMSE {error:.4}");
    }
    Ok(())
}

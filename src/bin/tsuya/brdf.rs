//! `tsuya brdf`: measured materials.

mod asset;
mod convert;
mod eval;
mod fit;
mod font;
pub mod material;
mod measured;
mod next;
mod plan;
mod render;
mod sheet;

use anyhow::Result;
use clap::{Args, Subcommand};

/// Plans measurements; reads, fits, converts and shows measured materials: values of a goniometer (.csv), MERL tables (.binary), RGL
/// materials (.bsdf), fitted ones (.tsuya, .json).
#[derive(Args)]
pub struct Brdf {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Fit(fit::Fit),
    Convert(convert::Convert),
    Eval(eval::Eval),
    Render(render::Render),
    Plan(plan::Plan),
    Next(next::Next),
}

impl Brdf {
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::Fit(fit) => fit.run(),
            Command::Convert(convert) => convert.run(),
            Command::Eval(eval) => eval.run(),
            Command::Render(render) => render.run(),
            Command::Plan(plan) => plan.run(),
            Command::Next(next) => next.run(),
        }
    }
}

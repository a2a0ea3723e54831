//! Completions for shells, and manual pages.

use crate::{Cli, output};
use anyhow::Result;
use clap::{Args, CommandFactory};
use std::path::PathBuf;

/// Prints the completions of a shell.
#[derive(Args)]
pub struct Completions {
    /// The shell.
    shell: clap_complete::Shell,
}

impl Completions {
    pub fn run(self) -> Result<()> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "tsuya", &mut script);
        output::print_verbatim(&String::from_utf8_lossy(&script))
    }
}

/// Prints the manual page, or writes one for each subcommand into a folder.
#[derive(Args)]
pub struct Man {
    /// The folder; without it the program's own page goes to standard output.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Overwrites existing pages.
    #[arg(long)]
    force: bool,
}

impl Man {
    pub fn run(self) -> Result<()> {
        let mut program = Cli::command().disable_help_subcommand(true);
        program.build();
        let page = |command: clap::Command| -> Result<Vec<u8>> {
            let mut page = Vec::new();
            clap_mangen::Man::new(command).render(&mut page)?;
            Ok(page)
        };
        let Some(folder) = &self.output else {
            return output::print_verbatim(&String::from_utf8_lossy(&page(program)?));
        };
        std::fs::create_dir_all(folder).map_err(|e| tsuya::Error::io(folder, e))?;
        let mut files = output::Files::new(self.force);
        for command in program.get_subcommands() {
            let name = format!("tsuya-{}", command.get_name());
            files.add(&folder.join(format!("{name}.1")), &page(command.clone())?)?;
        }
        files.add(&folder.join("tsuya.1"), &page(program)?)?;
        files.commit()
    }
}

//! Completions for shells, and manual pages.

use crate::{Cli, EXIT_STATUS, output};
use anyhow::Result;
use clap::{Args, CommandFactory};
use std::path::{Path, PathBuf};

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

/// Prints the manual page, or writes one for each command into a folder.
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
        let Some(folder) = &self.output else {
            return output::print_verbatim(&String::from_utf8_lossy(&page(&program)?));
        };
        std::fs::create_dir_all(folder).map_err(|e| tsuya::Error::io(folder, e))?;
        let mut files = output::Files::new(self.force);
        add_pages(&mut files, folder, "tsuya", &program)?;
        files.commit()
    }
}

/// Adds the page of a command, and those of the commands below it.
fn add_pages(files: &mut output::Files, folder: &Path, name: &str, command: &clap::Command) -> Result<()> {
    files.add(&folder.join(format!("{name}.1")), &page(command)?)?;
    for below in command.get_subcommands() {
        add_pages(files, folder, &format!("{name}-{}", below.get_name()), below)?;
    }
    Ok(())
}

/// The manual page of a command.
fn page(command: &clap::Command) -> Result<Vec<u8>> {
    let mut page = Vec::new();
    clap_mangen::Man::new(command.clone()).render(&mut page)?;
    page.extend_from_slice(b".SH \"EXIT STATUS\"\n");
    for (code, meaning) in EXIT_STATUS {
        page.extend_from_slice(format!(".TP\n\\fB{code}\\fR\n{meaning}\n").as_bytes());
    }
    Ok(page)
}

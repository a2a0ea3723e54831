//! Output: text to the terminal, and files, never over existing ones unasked, never a part of one under its name.

mod files;
mod folder;
mod place;
mod signals;
mod staging;
mod terminal;

pub use files::{Files, check_outputs, write};
pub use folder::Folder;
pub use place::is_same_file;
pub use signals::{clean_up_on_signals, wait_for_signal};
pub use staging::Staging;
pub use terminal::{is_plain_text as is_plain, line, without_controls};

use anyhow::Result;
use std::io::{Error as IoError, ErrorKind, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use tsuya::Error;

/// True for `-`, standard input or output.
pub fn is_stream(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Prints to standard output; what would steer a terminal is escaped. Texts from files within a line go through [`line`] first.
pub fn print(text: &str) -> Result<()> {
    print_verbatim(&terminal::lines(text))
}

/// Whether what a command did is told, progress included; warnings, errors and what was asked for always are.
static IS_QUIET: AtomicBool = AtomicBool::new(false);

/// Tells nothing from now on.
pub fn be_quiet() {
    IS_QUIET.store(true, Ordering::Relaxed);
}

/// True if nothing is told.
pub fn is_quiet() -> bool {
    IS_QUIET.load(Ordering::Relaxed)
}

/// Says what a command that writes files has done; see [`print`].
pub fn tell(text: &str) -> Result<()> {
    if is_quiet() { Ok(()) } else { print(text) }
}

/// Prints a value as JSON to standard output.
pub fn print_json(value: &serde_json::Value) -> Result<()> {
    print_verbatim(&terminal::json(&format!("{value:#}\n")))
}

/// Prints a text of the program's own to standard output.
pub fn print_verbatim(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).map_err(|e| Error::io("-", e))?;
    Ok(())
}

/// Prints a line to standard error; errors of that are ignored.
pub fn eprint_line(line: &str) {
    let _ = writeln!(std::io::stderr(), "{}", terminal::line(line));
}

/// Prints warnings to standard error.
pub fn warn(warnings: &[String]) {
    warnings.iter().for_each(|warning| eprint_line(&format!("warning: {}", with_flags(warning))));
}

/// Returns a message of the library with the program's flags and commands in place of the options and functions that it names.
pub fn with_flags(message: &str) -> String {
    const FUNCTIONS: [(&str, &str); 5] = [
        ("`capture::align`", "`tsuya align`"),
        ("`capture::visual_hull`", "`tsuya hull`"),
        ("`encoder::encode_modelled`", "`tsuya make`"),
        ("`gltf::inject`", "`tsuya gltf inject`"),
        ("`visibility::bake`", "`tsuya bake`"),
    ];
    let mut text = String::new();
    let mut parts = message.split("option `");
    text += parts.next().unwrap_or_default();
    for part in parts {
        let (option, rest) = part.split_once('`').unwrap_or((part, ""));
        let flag = if option == "memory_bytes" { "max-memory" } else { option };
        text += &format!("--{}{rest}", flag.replace('_', "-"));
    }
    FUNCTIONS.iter().fold(text, |text, (function, command)| text.replace(function, command))
}

fn exists(path: &Path) -> Error {
    Error::io(path, IoError::new(ErrorKind::AlreadyExists, "exists already; --force overwrites it"))
}

#[cfg(test)]
mod tests {
    use super::with_flags;

    #[test]
    fn options_and_functions_become_flags_and_commands() {
        for (message, expected) in [
            ("raise option `memory_bytes`; see option `mesh_scale` 2", "raise --max-memory; see --mesh-scale 2"),
            ("register it with `capture::align`", "register it with `tsuya align`"),
            ("put it back with `gltf::inject`", "put it back with `tsuya gltf inject`"),
            ("field `mesh`: nothing here", "field `mesh`: nothing here"),
        ] {
            assert_eq!(with_flags(message), expected);
        }
    }
}

//! Prints the checksums of files: for each one its name after `# `, then what [`checksums`] says.

use tsuya_checksums::checksums::checksums_of;

fn main() -> std::io::Result<()> {
    for path in std::env::args().skip(1) {
        let name = std::path::Path::new(&path).file_name().unwrap_or_default().to_string_lossy().into_owned();
        print!("# {name}\n{}", checksums_of(&std::fs::read(&path)?));
    }
    Ok(())
}

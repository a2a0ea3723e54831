//! Makes seeds for the fuzz targets, each fitting its target: `fuzz-seeds FOLDER` writes `FOLDER/TARGET/NAME`. Everything is made on the
//! spot, by the library's own writers and by hand; the same seeds each time.

#[allow(dead_code)]
#[path = "../src/folder.rs"]
mod folder;
#[allow(dead_code)]
#[path = "../src/pictures.rs"]
mod pictures;
#[path = "../src/scene.rs"]
mod scene;

mod files;
mod models;
mod photographs;
mod sections;
mod texts;

use std::path::PathBuf;

/// Where seeds go.
pub struct Seeds {
    folder: PathBuf,
}

impl Seeds {
    /// Writes a seed of a target.
    pub fn put(&self, target: &str, name: &str, content: impl AsRef<[u8]>) {
        let folder = self.folder.join(target);
        std::fs::create_dir_all(&folder).expect("a folder for seeds");
        std::fs::write(folder.join(name), content).expect("room for a seed");
    }
}

fn main() {
    let folder = std::env::args_os().nth(1).expect("fuzz-seeds FOLDER");
    let seeds = Seeds { folder: folder.into() };
    files::put(&seeds);
    sections::put(&seeds);
    models::put(&seeds);
    photographs::put(&seeds);
    texts::put(&seeds);
    noise(&seeds);
}

/// Numbers without a pattern (xorshift), for targets that make values of them.
fn noise(seeds: &Seeds) {
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as u8
    };
    for number in 0..48usize {
        let bytes: Vec<u8> = (0..64 << (number % 5)).map(|_| next()).collect();
        for target in ["entropy", "typed_round_trip", "typed_sections", "typed_file"] {
            let mut bytes = bytes.clone();
            if target == "typed_sections" {
                // The first byte chooses the section.
                bytes[0] = number as u8;
            }
            seeds.put(target, &format!("noise-{number:02}"), bytes);
        }
    }
}

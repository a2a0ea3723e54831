//! The decoder's checksums on any machine. For WebAssembly: [`file`] gives memory for a file's bytes, [`decode`] the length of the text,
//! [`text`] where it lies.

pub mod checksums;

use std::sync::Mutex;

static FILE: Mutex<Vec<u8>> = Mutex::new(Vec::new());
static TEXT: Mutex<String> = Mutex::new(String::new());

/// Memory for the file's bytes.
#[unsafe(no_mangle)]
pub extern "C" fn file(length: usize) -> *const u8 {
    let Ok(mut file) = FILE.lock() else { return std::ptr::null() };
    *file = vec![0; length];
    file.as_ptr()
}

/// Decodes the file; gives the length of the text.
#[unsafe(no_mangle)]
pub extern "C" fn decode() -> usize {
    let (Ok(file), Ok(mut text)) = (FILE.lock(), TEXT.lock()) else { return 0 };
    *text = checksums::checksums_of(&file);
    text.len()
}

/// Where the text lies.
#[unsafe(no_mangle)]
pub extern "C" fn text() -> *const u8 {
    TEXT.lock().map_or(std::ptr::null(), |text| text.as_ptr())
}

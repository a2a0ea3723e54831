//! What went wrong.

use std::ffi::{CStr, CString, c_char};

/// How a call went.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// Well.
    Ok = 0,
    /// An argument is wrong.
    Parameter = 1,
    /// The system refused to read.
    Io = 2,
    /// The file is wrong.
    Format = 3,
    /// The file asks for more than the limits allow.
    Limits = 4,
    /// Valid, but not read by this version.
    Unsupported = 5,
    /// The file does not hold what was asked for.
    Absent = 6,
    /// A defect of the library.
    Internal = 7,
}

/// What went wrong, as a sentence.
pub struct Error {
    status: Status,
    message: CString,
}

impl Error {
    pub(crate) fn new(status: Status, message: &str) -> Self {
        Error { status, message: c_string(message) }
    }
    pub(crate) fn null() -> Self {
        Error::new(Status::Parameter, "a null pointer was given")
    }
    pub(crate) fn status(&self) -> Status {
        self.status
    }
}

impl From<tsuya::Error> for Error {
    fn from(error: tsuya::Error) -> Self {
        use tsuya::Error::{Format, Input, InputMemory, Io, Limits, Parameter, Unsupported};
        let status = match &error {
            Io { .. } => Status::Io,
            Format { .. } | Input { .. } => Status::Format,
            Limits { .. } | InputMemory { .. } => Status::Limits,
            Unsupported(_) => Status::Unsupported,
            Parameter(_) => Status::Parameter,
            _ => Status::Internal,
        };
        Error::new(status, &error.to_string())
    }
}

/// Text for C, up to the first zero.
pub(crate) fn c_string(text: &str) -> CString {
    let end = text.find('\0').unwrap_or(text.len());
    CString::new(&text[..end]).unwrap_or_default()
}

/// What went wrong: a sentence in UTF-8. Empty for null.
///
/// # Safety
/// `error` is null or an error that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_error_message(error: *const Error) -> *const c_char {
    // SAFETY: as the caller says.
    let error = unsafe { error.as_ref() };
    error.map_or(c"", |error| -> &CStr { &error.message }).as_ptr()
}

/// Frees an error; null is left alone.
///
/// # Safety
/// `error` is null or an error that was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_error_free(error: *mut Error) {
    // SAFETY: as the caller says.
    unsafe { crate::free(error) }
}

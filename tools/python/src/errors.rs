//! Errors of the library as exceptions.

use pyo3::PyErr;
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyOSError, PyValueError};

create_exception!(tsuya, Error, PyException, "What the other exceptions of the package have in common.");
create_exception!(
    tsuya,
    FormatError,
    Error,
    "A .tsuya file is wrong: section, byte and what the specification requires."
);
create_exception!(
    tsuya,
    InputError,
    Error,
    "An input (photograph, mesh, description of a capture) is wrong: file, place and remedy."
);
create_exception!(tsuya, LimitError, Error, "A file asks for more than its limits allow; `memory_bytes` raises them.");
create_exception!(tsuya, UnsupportedError, Error, "Valid, but not read by this version.");
create_exception!(tsuya, CheckError, Error, "An encoded file does not give back what was put into it.");

/// The exception for an error: `OSError` (of the kind that its number asks for) where the system refused, `ValueError` where an argument is
/// wrong, one of the package's own elsewhere.
pub fn raise(error: tsuya::Error) -> PyErr {
    let message = error.to_string();
    match error {
        tsuya::Error::Io { path, source } => match source.raw_os_error() {
            Some(number) => PyOSError::new_err((number, source.to_string(), path.into_os_string())),
            None => PyOSError::new_err(message),
        },
        tsuya::Error::Format { .. } => FormatError::new_err(message),
        tsuya::Error::Input { .. } => InputError::new_err(message),
        tsuya::Error::Unsupported(_) => UnsupportedError::new_err(message),
        tsuya::Error::Limits { .. } | tsuya::Error::InputMemory { .. } => LimitError::new_err(message),
        tsuya::Error::Check(_) => CheckError::new_err(message),
        tsuya::Error::Parameter(_) => PyValueError::new_err(message),
        _ => Error::new_err(message),
    }
}

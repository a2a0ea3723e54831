//! The header `Range` of HTTP (RFC 9110, section 14).

/// The part of a file that a request asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wanted {
    /// All of it.
    Whole,
    /// These bytes: first, and the one after the last.
    Part(u64, u64),
    /// Bytes that the file does not have.
    Unsatisfiable,
}

/// Reads the header's value for a file of `length` bytes. What is not understood, and several ranges at once, mean the whole file, as a server may answer.
pub fn parse(header: &str, length: u64) -> Wanted {
    let Some((unit, ranges)) = header.split_once('=') else { return Wanted::Whole };
    let Some((first, last)) = ranges.trim().split_once('-') else { return Wanted::Whole };
    let number = |text: &str| {
        // A sign would be taken for a number.
        text.bytes().all(|byte| byte.is_ascii_digit()).then(|| text.parse::<u64>()).and_then(Result::ok)
    };
    if !unit.trim().eq_ignore_ascii_case("bytes") {
        return Wanted::Whole;
    }
    match (first, number(first), last, number(last)) {
        // The last so many bytes.
        ("", _, _, Some(0)) => Wanted::Unsatisfiable,
        ("", _, _, Some(count)) if length > 0 => Wanted::Part(length.saturating_sub(count), length),
        ("", _, _, Some(_)) => Wanted::Unsatisfiable,
        (_, Some(from), "", _) if from < length => Wanted::Part(from, length),
        (_, Some(from), _, Some(to)) if to < from => Wanted::Whole,
        (_, Some(from), _, Some(to)) if from < length => Wanted::Part(from, to.saturating_add(1).min(length)),
        (_, Some(_), "", _) | (_, Some(_), _, Some(_)) => Wanted::Unsatisfiable,
        _ => Wanted::Whole,
    }
}

#[cfg(test)]
mod tests {
    use super::{Wanted::*, parse};

    #[test]
    fn ranges_are_read_as_the_standard_has_them() {
        let cases = [
            ("bytes=0-99", Part(0, 100)),
            ("bytes=900-", Part(900, 1000)),
            ("bytes=900-18446744073709551615", Part(900, 1000)),
            ("bytes=-8", Part(992, 1000)),
            ("bytes=-5000", Part(0, 1000)),
            ("Bytes=999-999", Part(999, 1000)),
            ("bytes=1000-", Unsatisfiable),
            ("bytes=1000-1001", Unsatisfiable),
            ("bytes=-0", Unsatisfiable),
            ("bytes=5-4", Whole),
            ("bytes=0-1,5-6", Whole),
            ("bytes=+1-2", Whole),
            ("bytes=--1", Whole),
            ("bytes=-", Whole),
            ("bytes=99999999999999999999-", Whole),
            ("lines=0-1", Whole),
            ("", Whole),
        ];
        for (header, wanted) in cases {
            assert_eq!(parse(header, 1000), wanted, "{header}");
        }
        assert_eq!(parse("bytes=0-", 0), Unsatisfiable);
        assert_eq!(parse("bytes=-1", 0), Unsatisfiable);
    }
}

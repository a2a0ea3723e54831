//! Text on its way to a terminal: what would steer it, or turn the text around, is shown as `\u{1b}`.

use std::fmt::Write;

/// Whether a character is shown as itself: no control, none that changes the direction or is invisible.
fn is_plain(c: char) -> bool {
    // Joiners (200c, 200d) belong to the writing of some languages.
    let hides = matches!(c, '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{200b}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}'
        | '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e0fff}');
    !c.is_control() && !hides
}

fn escaped(text: &str, is_plain: impl Fn(char) -> bool, escape: impl Fn(&mut String, char)) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if is_plain(c) { out.push(c) } else { escape(&mut out, c) }
    }
    out
}

/// Text of several lines.
pub fn lines(text: &str) -> String {
    escaped(text, |c| is_plain(c) || c == '\n' || c == '\t', |out, c| _ = write!(out, "{}", c.escape_unicode()))
}

/// One line, or a part of one.
pub fn line(text: &str) -> String {
    escaped(text, is_plain, |out, c| match c {
        '\n' => out.push_str("\\n"),
        '\t' => out.push_str("\\t"),
        '\r' => out.push_str("\\r"),
        _ => _ = write!(out, "{}", c.escape_unicode()),
    })
}

/// JSON, which says the same afterwards: these characters stand within its texts only.
pub fn json(text: &str) -> String {
    escaped(
        text,
        |c| is_plain(c) || c == '\n',
        |out, c| {
            c.encode_utf16(&mut [0; 2]).iter().for_each(|unit| _ = write!(out, "\\u{unit:04x}"));
        },
    )
}

/// Text without what [`line`] would escape.
pub fn without_controls(text: &str) -> String {
    text.chars().filter(|&c| is_plain(c)).collect()
}

/// Whether text is lines of plain characters.
pub fn is_plain_text(text: &str) -> bool {
    lines(text) == text
}

/// Whether bytes are not just lines of text.
pub fn has_controls(bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes).map_or(true, |text| !is_plain_text(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_steers_the_terminal() {
        let hostile =
            "a\u{1b}]0;x\u{7}\u{9b}31m\u{202e}txt.exe\u{200b}\u{2066}\u{e0041}\r\u{7f}\nverified: OK\té 漢 👍";
        let shown = lines(hostile);
        assert!(
            shown.starts_with(r"a\u{1b}]0;x\u{7}\u{9b}31m\u{202e}txt.exe\u{200b}\u{2066}\u{e0041}\u{d}\u{7f}"),
            "{shown}"
        );
        assert!(shown.ends_with("\nverified: OK\té 漢 👍"));
        assert!(line(hostile).ends_with(r"\u{7f}\nverified: OK\té 漢 👍"), "{}", line(hostile));
        let value = serde_json::json!({"title": hostile, hostile: [hostile]});
        let printed = json(&format!("{value:#}"));
        assert!(printed.chars().all(|c| is_plain(c) || c == '\n'));
        assert_eq!(serde_json::from_str::<serde_json::Value>(&printed).unwrap(), value);
        assert!(has_controls(hostile.as_bytes()) && has_controls(b"\xff") && !has_controls("a\té\n".as_bytes()));
    }
}

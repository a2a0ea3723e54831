//! JSON documents whose errors name file, line and key.

use crate::error::{Error, Result};
use crate::input::{FileAccess, FileText, quoted};
use crate::limits::Reservation;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Bytes of a JSON document, at most.
const MAX_BYTES: u64 = 64 << 20;

/// Letters of an identifier, at most.
const MAX_IDENTIFIER: usize = 64;

/// A parsed JSON file, with its text for finding lines. Its memory is charged as long as it lives.
pub(crate) struct JsonDocument<'a> {
    path: PathBuf,
    text: FileText<'a>,
    root: Value,
    _held: Reservation<'a>,
}

/// One value of a [`JsonDocument`] and the way to it, as in `frames[3].transform_matrix`.
#[derive(Clone)]
pub(crate) struct JsonNode<'a> {
    document: &'a JsonDocument<'a>,
    value: &'a Value,
    pub(crate) key: String,
}

/// Returns an upper bound of the memory of a JSON text's values; lists and objects may have grown to twice their need.
fn parsed_bytes(text: &str) -> u64 {
    let cost = |byte: u8| match byte {
        b'{' => 512,
        b'[' | b':' => 160,
        b',' => 64,
        _ => 1,
    };
    text.bytes().map(cost).sum()
}

impl<'a> JsonDocument<'a> {
    pub(crate) fn read(path: &Path, access: &'a FileAccess) -> Result<Self> {
        let text = access.read_text(path, "JSON document", MAX_BYTES)?;
        let held = access.reserve(path, "JSON document", parsed_bytes(&text))?;
        let root = serde_json::from_str(&text).map_err(|e| {
            let (line, column) = (e.line(), e.column());
            let before: usize = text.split_inclusive('\n').take(line.saturating_sub(1)).map(str::len).sum();
            let key = match key_at(&text, before + column.saturating_sub(1)) {
                key if key.is_empty() => String::new(),
                key => format!(", in or after key {key}"),
            };
            Error::input(path, format!("line {line}, column {column}{key}: not JSON: {}", without_place(&e)))
        })?;
        Ok(JsonDocument { path: path.to_owned(), text, root, _held: held })
    }
    pub(crate) fn root(&self) -> JsonNode<'_> {
        JsonNode { document: self, value: &self.root, key: String::new() }
    }
}

fn without_place(error: &serde_json::Error) -> String {
    let text = error.to_string();
    text.split(" at line ").next().unwrap_or_default().to_owned()
}

impl<'a> JsonNode<'a> {
    /// An error that stands at this value.
    pub(crate) fn error(&self, message: impl std::fmt::Display) -> Error {
        let line = line_of(&self.document.text, &self.key);
        let key = if self.key.is_empty() { "top level" } else { &self.key };
        Error::input(&self.document.path, format!("line {line}, {key}: {message}"))
    }
    fn expected(&self, what: &str) -> Error {
        let found = match self.value {
            Value::Null => "null".to_owned(),
            Value::Object(_) => "an object".to_owned(),
            Value::Array(items) => format!("a list of {}", items.len()),
            Value::String(text) => quoted(text),
            other => other.to_string(),
        };
        self.error(format!("expected {what}, found {found}"))
    }
    /// The value under a key of this object; absent and `null` are the same.
    pub(crate) fn get(&self, key: &str) -> Option<JsonNode<'a>> {
        let value = self.value.as_object()?.get(key).filter(|v| !v.is_null())?;
        let path = if self.key.is_empty() { key.to_owned() } else { format!("{}.{key}", self.key) };
        Some(JsonNode { document: self.document, value, key: path })
    }
    pub(crate) fn required(&self, key: &str) -> Result<JsonNode<'a>> {
        if !self.value.is_object() {
            return Err(self.expected("an object"));
        }
        self.get(key).ok_or_else(|| self.error(format!("key \"{key}\" is missing")))
    }
    pub(crate) fn is_list(&self) -> bool {
        self.value.is_array()
    }
    pub(crate) fn is_true(&self) -> bool {
        *self.value == Value::Bool(true)
    }
    /// The items of a list of at most `max`.
    pub(crate) fn items(&self, max: usize) -> Result<Vec<JsonNode<'a>>> {
        let items = self.value.as_array().ok_or_else(|| self.expected("a list"))?;
        if items.len() > max {
            return Err(self.error(format!("a list of {}, {max} at most are read", items.len())));
        }
        let node = |(index, value)| JsonNode { document: self.document, value, key: format!("{}[{index}]", self.key) };
        Ok(items.iter().enumerate().map(node).collect())
    }
    pub(crate) fn number(&self) -> Result<f64> {
        self.value.as_f64().filter(|v| v.is_finite()).ok_or_else(|| self.expected("a number"))
    }
    /// A number, or a text that holds one, as writers of property trees put it.
    pub(crate) fn written_number(&self) -> Result<f64> {
        match self.value.as_str().map(|text| text.trim().parse::<f64>()) {
            Some(Ok(number)) if number.is_finite() => Ok(number),
            _ => self.number(),
        }
    }
    /// Numbers, written in either way; an empty text is an empty list.
    pub(crate) fn written_numbers(&self, max: usize) -> Result<Vec<f64>> {
        if self.value.as_str().is_some_and(str::is_empty) {
            return Ok(Vec::new());
        }
        self.items(max)?.iter().map(JsonNode::written_number).collect()
    }
    /// A name or a whole number by which others refer to an object.
    pub(crate) fn identifier(&self) -> Result<String> {
        match self.value {
            Value::String(text) if text.len() <= MAX_IDENTIFIER => Ok(text.clone()),
            Value::Number(number) => Ok(number.to_string()),
            _ => Err(self.expected("an identifier")),
        }
    }
    /// A count, which some tools write as `1080.0`.
    pub(crate) fn count(&self) -> Result<u32> {
        let value = self.number()?;
        if value.fract() == 0.0 && (0.0..=u32::MAX as f64).contains(&value) {
            Ok(value as u32)
        } else {
            Err(self.expected("a whole number"))
        }
    }
    pub(crate) fn text(&self) -> Result<&'a str> {
        self.value.as_str().ok_or_else(|| self.expected("a text"))
    }
    pub(crate) fn numbers<const N: usize>(&self) -> Result<[f64; N]> {
        if self.value.as_array().is_some_and(|items| items.len() != N) {
            return Err(self.expected(&format!("a list of {N} numbers")));
        }
        let items = self.items(N)?;
        let mut numbers = [0.0; N];
        for (number, item) in numbers.iter_mut().zip(&items) {
            *number = item.number()?;
        }
        Ok(numbers)
    }
    /// A 4 x 4 matrix by rows; 3 x 4 is taken with the last row `0 0 0 1`.
    pub(crate) fn matrix(&self) -> Result<[[f64; 4]; 4]> {
        if self.value.as_array().is_some_and(|rows| rows.len() != 3 && rows.len() != 4) {
            return Err(self.expected("a matrix of 4 rows of 4 numbers"));
        }
        let rows = self.items(4)?;
        let mut matrix = [[0.0, 0.0, 0.0, 0.0], [0.0; 4], [0.0; 4], [0.0, 0.0, 0.0, 1.0]];
        for (target, row) in matrix.iter_mut().zip(&rows) {
            *target = row.numbers()?;
        }
        if matrix[3] != [0.0, 0.0, 0.0, 1.0] {
            return Err(self.error("the last row of the matrix should be 0 0 0 1"));
        }
        Ok(matrix)
    }
    pub(crate) fn optional<T>(&self, key: &str, read: impl Fn(&JsonNode<'a>) -> Result<T>) -> Result<Option<T>> {
        self.get(key).map(|node| read(&node)).transpose()
    }
}

/// Position of a walk in an object or a list.
enum JsonLevel<'a> {
    Object { key: &'a str, expects_key: bool },
    List { index: usize },
}

/// Walks through (possibly broken) JSON and tells `visit` the offset of every value and the way to it; `visit` ends it with `true`.
fn walk<'a>(text: &'a str, mut visit: impl FnMut(usize, &[JsonLevel<'a>]) -> bool) {
    let bytes = text.as_bytes();
    let mut stack: Vec<JsonLevel> = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let start = at;
        at += 1;
        match bytes[start] {
            b' ' | b'\t' | b'\r' | b'\n' | b':' => continue,
            b'}' | b']' => {
                stack.pop();
                continue;
            }
            b',' => {
                match stack.last_mut() {
                    Some(JsonLevel::Object { expects_key, .. }) => *expects_key = true,
                    Some(JsonLevel::List { index }) => *index += 1,
                    None => {}
                }
                continue;
            }
            b'"' => {
                while at < bytes.len() && bytes[at] != b'"' {
                    at += if bytes[at] == b'\\' { 2 } else { 1 };
                }
                let content = text.get(start + 1..at.min(bytes.len())).unwrap_or_default();
                at += 1;
                if let Some(JsonLevel::Object { key, expects_key }) = stack.last_mut()
                    && *expects_key
                {
                    *key = content;
                    *expects_key = false;
                    continue;
                }
            }
            b'{' | b'[' => {}
            _ => {
                while at < bytes.len() && !b",]} \t\r\n".contains(&bytes[at]) {
                    at += 1;
                }
            }
        }
        if visit(start, &stack) {
            return;
        }
        match bytes[start] {
            b'{' => stack.push(JsonLevel::Object { key: "", expects_key: true }),
            b'[' => stack.push(JsonLevel::List { index: 0 }),
            _ => {}
        }
    }
}

/// The way to a value in words, as [`JsonNode::key`] has it; no longer than messages can bear.
fn key_path(stack: &[JsonLevel]) -> String {
    let mut path = String::new();
    for level in stack.iter().take(12) {
        match level {
            JsonLevel::Object { key, .. } => {
                let dot = if path.is_empty() { "" } else { "." };
                path.extend([dot.into(), key.chars().take(40).flat_map(char::escape_debug).collect::<String>()]);
            }
            JsonLevel::List { index } => path.push_str(&format!("[{index}]")),
        }
    }
    path + if stack.len() > 12 { "..." } else { "" }
}

/// Line (from 1) at which the value with this key path begins.
fn line_of(text: &str, wanted: &str) -> usize {
    let steps: Vec<&str> = wanted.split(['.', '[']).filter(|step| !step.is_empty()).collect();
    let is_step = |(level, step): (&JsonLevel, &&str)| match level {
        JsonLevel::Object { key, .. } => key == step,
        JsonLevel::List { index } => step.strip_suffix(']').is_some_and(|number| number.parse() == Ok(*index)),
    };
    let mut offset = 0;
    walk(text, |at, stack| {
        // From the end, where most differ.
        let found = stack.len() == steps.len() && stack.iter().rev().zip(steps.iter().rev()).all(is_step);
        if found {
            offset = at;
        }
        found
    });
    1 + text.as_bytes()[..offset].iter().filter(|&&b| b == b'\n').count()
}

/// Key path of the last value that begins at or before an offset.
fn key_at(text: &str, offset: usize) -> String {
    let mut last = 0;
    walk(text, |at, _| {
        if at <= offset {
            last = at;
        }
        at > offset
    });
    let mut key = String::new();
    walk(text, |at, stack| {
        if at == last {
            key = key_path(stack);
        }
        at >= last
    });
    key
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document<'a>(text: &str, access: &'a FileAccess) -> Result<JsonDocument<'a>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("some.json");
        std::fs::write(&path, text).unwrap();
        JsonDocument::read(&path, access)
    }

    #[test]
    fn errors_name_line_and_key() {
        let text = "{\n \"w\": 4,\n \"frames\": [\n  {\"a\": [1, 2]},\n  {\"a\": [1, \"x\"],\n   \"b\": {\"c\\\"\": 1}}\n ]\n}";
        let access = FileAccess::default();
        let document = document(text, &access).unwrap();
        let frames = document.root().required("frames").unwrap().items(9).unwrap();
        assert_eq!(frames[0].required("a").unwrap().numbers::<2>().unwrap(), [1.0, 2.0]);
        let error = frames[1].required("a").unwrap().numbers::<2>().unwrap_err().to_string();
        assert!(error.ends_with("some.json: line 5, frames[1].a[1]: expected a number, found \"x\""), "{error}");
        let error = frames[1].required("name").err().unwrap().to_string();
        assert!(error.ends_with("line 5, frames[1]: key \"name\" is missing"), "{error}");
        let error = frames[1].required("b").unwrap().items(9).err().unwrap().to_string();
        assert!(error.ends_with("line 6, frames[1].b: expected a list, found an object"), "{error}");
    }

    #[test]
    fn broken_text_names_line_and_key() {
        let access = FileAccess::default();
        let document = |text: &str| document(text, &access);
        let error = document("{\"a\": 1,\n \"frames\": [{\"m\": [1, NaN]}]}").err().unwrap().to_string();
        assert!(error.contains("line 2") && error.contains("frames[0].m[1]"), "{error}");
        for text in ["", "{", "{\"a\"", "{\"a\": \"\\", "[1, 2", "\u{fffd}"] {
            assert!(matches!(document(text), Err(Error::Input { .. })), "{text}");
        }
        // Neither depth nor long keys make a message long, or finding the place slow.
        let deep = "[".repeat(100_000);
        let error = document(&deep).err().unwrap().to_string();
        assert!(
            error.contains("in or after key [0][0]") && error.contains("...: not JSON: recursion limit"),
            "{error}"
        );
        let long = format!("{{\"{}\": [{}x]}}", "k".repeat(100_000), "1, ".repeat(100_000));
        let error = document(&long).err().unwrap().to_string();
        assert!(error.contains(&format!("after key {}[100000]: not JSON", "k".repeat(40))), "{error}");
    }
}

//! Measurements as JSON: a list of objects with the fields of a table's columns.

use serde_json::{Map, Value};
use std::borrow::Cow;
use std::collections::BTreeSet;

/// Names of fields and the cells of each sample, in the order of the names.
pub(super) type FieldRows = (Vec<String>, Vec<Vec<Cow<'static, str>>>);

/// Returns `true` for a text that begins as JSON does.
pub(super) fn is_json(text: &str) -> bool {
    text.trim_start_matches(|c: char| c.is_whitespace() || c == '\u{feff}').starts_with(['[', '{'])
}

/// Reads a list of objects, or an object with such a list as `samples`.
pub(super) fn rows(text: &str) -> Result<FieldRows, String> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let value: Value = serde_json::from_str(text).map_err(|e| format!("not JSON: {e}"))?;
    let list = match value {
        Value::Array(list) => list,
        Value::Object(mut object) => match object.remove("samples") {
            Some(Value::Array(list)) => list,
            _ => return Err("an object has its measurements as a list `samples`".into()),
        },
        _ => return Err("not a list of measurements".into()),
    };
    let (mut names, mut known) = (Vec::<String>::new(), BTreeSet::new());
    let mut found = Vec::new();
    for (index, sample) in list.iter().enumerate() {
        let place = |what: &str| format!("sample {}: {what}", index + 1);
        let Value::Object(fields) = sample else { return Err(place("not an object")) };
        if index == 0 {
            names = fields.keys().cloned().collect();
            known = names.iter().cloned().collect();
            // Fields that are left out take no bytes, but a cell of every row.
            if names.len().saturating_mul(list.len()) > text.len() {
                return Err("most samples lack most fields of the first; write null for what was not measured".into());
            }
        }
        if !fields.keys().all(|key| known.contains(key)) {
            return Err(place("it has other fields than the first; write null for what was not measured"));
        }
        found.push(cells(fields, &names).map_err(|what| place(&what))?);
    }
    Ok((names, found))
}

fn cells(fields: &Map<String, Value>, names: &[String]) -> Result<Vec<Cow<'static, str>>, String> {
    let cell = |name: &String| match fields.get(name) {
        None | Some(Value::Null) => Ok(Cow::Borrowed("")),
        Some(Value::Number(number)) => Ok(Cow::Owned(number.to_string())),
        Some(Value::String(text)) => Ok(Cow::Owned(text.clone())),
        Some(_) => Err(format!("field {} is not a number", crate::input::quoted(name))),
    };
    names.iter().map(cell).collect()
}

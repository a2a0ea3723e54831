//! XML documents whose errors name file, line and element.

use crate::error::{Error, Result};
use crate::input::{FileAccess, escaped, quoted};
use roxmltree::{Document, Node};
use std::path::Path;

/// Bytes of an XML document, at most.
const MAX_BYTES: u64 = 256 << 20;

/// One element of a document.
#[derive(Clone, Copy)]
pub(super) struct XmlElement<'a> {
    path: &'a Path,
    node: Node<'a, 'a>,
}

/// Returns an upper bound of the memory of a document's nodes and attributes.
fn parsed_bytes(text: &str) -> u64 {
    let cost = |byte: u8| match byte {
        b'<' => 256,
        b'=' => 128,
        _ => 1,
    };
    text.bytes().map(cost).sum()
}

/// Parses a file and hands its root element to `read`. Documents with a DTD are refused, so no entity can expand.
pub(super) fn read<T>(path: &Path, access: &FileAccess, read: impl FnOnce(XmlElement) -> Result<T>) -> Result<T> {
    let text = access.read_text(path, "XML document", MAX_BYTES)?;
    let _held = access.reserve(path, "XML document", parsed_bytes(&text))?;
    let document = Document::parse(&text).map_err(|e| Error::input(path, format!("not XML: {e}")))?;
    read(XmlElement { path, node: document.root_element() })
}

impl<'a> XmlElement<'a> {
    pub(super) fn name(&self) -> &'a str {
        self.node.tag_name().name()
    }

    /// An error that stands at this element.
    pub(super) fn error(&self, message: impl std::fmt::Display) -> Error {
        let line = self.node.document().text_pos_at(self.node.range().start).row;
        Error::input(self.path, format!("line {line}, <{}>: {message}", escaped(self.name())))
    }

    /// The elements in this one, of this name where one is given.
    pub(super) fn children(&self, name: &'a str) -> impl Iterator<Item = XmlElement<'a>> + use<'a> {
        let path = self.path;
        let found = self.node.children().filter(move |node| node.is_element() && node.tag_name().name() == name);
        found.map(move |node| XmlElement { path, node })
    }

    /// The elements of a name at any depth in this one.
    pub(super) fn descendants(&self, name: &'a str) -> impl Iterator<Item = XmlElement<'a>> + use<'a> {
        let path = self.path;
        let found = self.node.descendants().filter(move |node| node.is_element() && node.tag_name().name() == name);
        found.map(move |node| XmlElement { path, node })
    }

    pub(super) fn child(&self, name: &'a str) -> Option<XmlElement<'a>> {
        self.children(name).next()
    }

    /// An attribute by its local name.
    pub(super) fn attribute(&self, name: &str) -> Option<&'a str> {
        self.node.attributes().find(|attribute| attribute.name() == name).map(|attribute| attribute.value())
    }

    pub(super) fn text(&self) -> &'a str {
        self.node.text().unwrap_or_default().trim()
    }

    /// The text of an attribute, or of a child of that name.
    pub(super) fn property(&self, name: &'a str) -> Option<&'a str> {
        self.attribute(name).or_else(|| self.child(name).map(|child| child.text()))
    }

    /// Finite numbers out of a text of this element, which `what` names.
    pub(super) fn numbers<const N: usize>(&self, what: &str, text: &str) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        let mut words = text.split_whitespace();
        for number in &mut numbers {
            let word = words.next().ok_or_else(|| self.error(format!("{what} should be {N} numbers")))?;
            let parsed = word.parse::<f64>().ok().filter(|number| number.is_finite());
            *number = parsed.ok_or_else(|| self.error(format!("{what} should be numbers, found {}", quoted(word))))?;
        }
        if words.next().is_some() {
            return Err(self.error(format!("{what} should be {N} numbers, there are more")));
        }
        Ok(numbers)
    }

    /// The number under a name, if it is there.
    pub(super) fn number(&self, name: &'a str) -> Result<Option<f64>> {
        let read = |text| Ok::<f64, Error>(self.numbers::<1>(name, text)?[0]);
        self.property(name).map(read).transpose()
    }

    /// The whole number of an attribute.
    pub(super) fn count(&self, name: &str) -> Result<u32> {
        let text = self.attribute(name).ok_or_else(|| self.error(format!("attribute {name} is missing")))?;
        text.parse()
            .map_err(|_| self.error(format!("attribute {name} should be a whole number, found {}", quoted(text))))
    }
}

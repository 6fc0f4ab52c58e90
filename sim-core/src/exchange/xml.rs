//! Writer of XML: indented elements, attributes in their given order, and escaped values.

use crate::base::math::{Rotation, Vector};

/// Name and value of an attribute.
pub(super) type Attribute = (&'static str, String);

/// XML document under construction.
pub(super) struct Writer {
    text: String,
    open: Vec<&'static str>,
}

impl Writer {
    /// Creates a document with only its declaration.
    pub fn new() -> Self {
        Self { text: "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n".to_owned(), open: Vec::new() }
    }

    /// Writes a comment of one or more lines.
    pub fn comment(&mut self, text: &str) {
        // A comment must not hold "--", but names may. It is replaced twice, because pairs overlap in "---".
        let text = text.replace("--", "- -").replace("--", "- -").replace('\n', &format!("\n{}     ", self.indent()));
        self.line(&format!("<!-- {text} -->"));
    }

    /// Writes an element without content.
    pub fn leaf(&mut self, tag: &'static str, attributes: &[Attribute]) {
        self.line(&format!("<{tag}{}/>", listed(attributes)));
    }

    /// Begins an element. [`Writer::close`] ends it.
    pub fn open(&mut self, tag: &'static str, attributes: &[Attribute]) {
        self.line(&format!("<{tag}{}>", listed(attributes)));
        self.open.push(tag);
    }

    /// Ends the element that was begun last.
    pub fn close(&mut self) {
        if let Some(tag) = self.open.pop() {
            self.line(&format!("</{tag}>"));
        }
    }

    /// Ends all open elements and returns the text.
    pub fn finish(mut self) -> String {
        while !self.open.is_empty() {
            self.close();
        }
        self.text
    }

    fn indent(&self) -> String {
        "  ".repeat(self.open.len())
    }

    fn line(&mut self, line: &str) {
        self.text += &format!("{}{line}\n", self.indent());
    }
}

fn listed(attributes: &[Attribute]) -> String {
    attributes.iter().map(|(name, value)| format!(" {name}=\"{}\"", escaped(value))).collect()
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Formats x, y, z, each with the fewest digits that give its bits again.
pub(super) fn triple(v: Vector) -> String {
    format!("{} {} {}", v.x, v.y, v.z)
}

/// Formats a quaternion in MuJoCo's order: w, x, y, z.
pub(super) fn quaternion(q: Rotation) -> String {
    format!("{} {} {} {}", q.w, q.x, q.y, q.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn document_with_special_characters_is_well_formed() {
        let mut xml = Writer::new();
        xml.comment("a--b---c");
        xml.open("robot", &[("name", "<\"&'>".to_owned())]);
        xml.leaf("link", &[]);
        let text = xml.finish();
        assert_eq!(
            text,
            "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<!-- a- -b- - -c -->\n\
             <robot name=\"&lt;&quot;&amp;'&gt;\">\n  <link/>\n</robot>\n"
        );
    }
}

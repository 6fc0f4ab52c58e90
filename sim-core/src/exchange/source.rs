//! Access to XML: elements by tag, numbers, and errors with their line.

use crate::base::error::{Invalid, whole_in_range};
use crate::base::limits::{MAX_TOML_LENGTH, MAX_XML_DEPTH};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use roxmltree::{Document, Node};

/// Greatest magnitude of any number.
const LARGEST: f64 = 1e9;

/// Reason to refuse a file that xacro must expand first.
pub(super) const XACRO: &str = "this file needs xacro: run `xacro FILE > robot.urdf` first and import the result";

/// Returns true if a value has an expression that xacro must expand first.
pub(super) fn has_expression(value: &str) -> bool {
    value.contains("${") || value.contains("$(")
}

/// Parses a document. Refuses text that is too long, not XML, or nested too deeply.
pub(super) fn parse(text: &str) -> Result<Document<'_>, Invalid> {
    whole_in_range("length of the robot's text", text.len() as u64, (0, MAX_TOML_LENGTH as u64), "bytes")?;
    let document = Document::parse(text).map_err(|error| not_xml(text, &error))?;
    let mut open = vec![(document.root_element(), 1)];
    while let Some((element, depth)) = open.pop() {
        if depth > MAX_XML_DEPTH {
            return Err(foreign(
                element,
                format!("it is nested too deeply: at most {MAX_XML_DEPTH} levels of elements are allowed"),
            ));
        }
        open.extend(children(element).map(|child| (child, depth + 1)));
    }
    Ok(document)
}

/// Returns the error for a text that is not XML or has a document type.
fn not_xml(text: &str, error: &roxmltree::Error) -> Invalid {
    let start: String = text.trim_start().chars().take(200).collect::<String>().to_ascii_lowercase();
    let message = if text.trim().is_empty() {
        "the file is empty: MJCF begins with <mujoco>, URDF with <robot>".to_owned()
    } else if start.contains("<html") || start.contains("<!doctype html") {
        "this is a web page, not a robot file: download the file itself".to_owned()
    } else if let roxmltree::Error::DtdDetected = error {
        let at = text.to_ascii_lowercase().find("<!doctype").unwrap_or(0);
        let line = 1 + text.as_bytes()[..at].iter().filter(|byte| **byte == b'\n').count();
        format!("line {line}: a document type can't be imported: remove <!DOCTYPE …>")
    } else {
        format!("this is not XML: {error}")
    };
    Invalid::Syntax { message }
}

/// Returns the elements in an element.
pub(super) fn children<'a>(element: Node<'a, 'a>) -> impl Iterator<Item = Node<'a, 'a>> {
    element.children().filter(Node::is_element)
}

/// Returns the tag of an element.
pub(super) fn tag<'a>(element: Node<'a, 'a>) -> &'a str {
    element.tag_name().name()
}

/// Returns the first child with this tag.
pub(super) fn child<'a>(element: Node<'a, 'a>, wanted: &str) -> Option<Node<'a, 'a>> {
    children(element).find(|c| tag(*c) == wanted)
}

/// Returns the error that refuses an element.
pub(super) fn foreign(element: Node, reason: impl Into<String>) -> Invalid {
    refusal(element, element.range().start, reason.into())
}

/// Returns the error that refuses an attribute of an element, with the attribute's own line.
pub(super) fn foreign_attribute(element: Node, attribute: &str, reason: impl Into<String>) -> Invalid {
    let own = element.attributes().find(|a| a.name() == attribute);
    refusal(element, own.map_or(element.range().start, |a| a.range().start), reason.into())
}

fn refusal(element: Node, at: usize, reason: String) -> Invalid {
    // Attributes that identify an element for the user.
    let known = ["name", "class", "link", "joint", "file"];
    let own = known.iter().find_map(|a| Some(format!(" {a}=\"{}\"", element.attribute(*a)?)));
    let shortened = |text: String| text.chars().take(100).collect::<String>();
    Invalid::Foreign {
        line: element.document().text_pos_at(at).row,
        element: shortened(format!("<{}{}>", tag(element), own.unwrap_or_default())),
        reason,
    }
}

/// Parses any number of finite numbers, separated by spaces.
pub(super) fn numbers(element: Node, attribute: &str, text: &str) -> Result<Vec<f64>, Invalid> {
    let number = |word: &str| word.parse().ok().filter(|v: &f64| v.abs() <= LARGEST);
    text.split_whitespace().map(number).collect::<Option<Vec<f64>>>().ok_or_else(|| {
        let reason = match has_expression(text) {
            true => XACRO.to_owned(),
            false => {
                format!("{attribute} = \"{text}\" is not a list of numbers: numbers between ±{LARGEST:e} are needed")
            }
        };
        foreign_attribute(element, attribute, reason)
    })
}

/// Parses exactly N numbers.
pub(super) fn exactly<const N: usize>(element: Node, attribute: &str, text: &str) -> Result<[f64; N], Invalid> {
    numbers(element, attribute, text)?.try_into().map_err(|_| {
        let plural = if N == 1 { "number is" } else { "numbers are" };
        foreign_attribute(element, attribute, format!("{attribute} = \"{text}\": {N} {plural} needed"))
    })
}

/// Refuses a number, or a list of numbers, that is not 0.
pub(super) fn zero(element: Node, attribute: &str, text: Option<&str>, why: &str) -> Result<(), Invalid> {
    let Some(text) = text else { return Ok(()) };
    if numbers(element, attribute, text)?.iter().all(|v| *v == 0.0) {
        return Ok(());
    }
    Err(foreign_attribute(element, attribute, format!("{attribute} = \"{text}\": only 0 is allowed, {why}")))
}

/// Returns the rotation of a quaternion w, x, y, z. A quaternion of unit length to f32 precision keeps its bits.
pub(super) fn rotation(element: Node, [w, x, y, z]: [f64; 4]) -> Result<UnitQuaternion<f64>, Invalid> {
    let quaternion = Quaternion::new(w, x, y, z);
    let length = quaternion.norm();
    if length < 1e-6 {
        return Err(foreign(element, "a rotation of length 0: a unit quaternion w, x, y, z is needed"));
    }
    let unit = if (length - 1.0).abs() < 1e-6 { quaternion } else { quaternion / length };
    Ok(UnitQuaternion::new_unchecked(unit))
}

/// Returns the rotation by `angle` rad about an axis.
pub(super) fn turn(element: Node, axis: [f64; 3], angle: f64) -> Result<UnitQuaternion<f64>, Invalid> {
    let length = Vector3::from(axis).norm();
    if length < 1e-6 {
        return Err(foreign(element, "the axis has no direction: its length must not be 0"));
    }
    let [x, y, z] = axis.map(|v| v / length * libm::sin(angle / 2.0));
    rotation(element, [libm::cos(angle / 2.0), x, y, z])
}

/// Returns the text if it is one of the allowed words.
pub(super) fn keyword<'a>(element: Node, attribute: &str, text: &'a str, allowed: &[&str]) -> Result<&'a str, Invalid> {
    if allowed.contains(&text) {
        return Ok(text);
    }
    let reason = format!("{attribute} = \"{text}\": allowed are {}", allowed.join(", "));
    Err(foreign_attribute(element, attribute, reason))
}

/// Returns an attribute that must be present.
pub(super) fn required<'a>(element: Node<'a, 'a>, attribute: &str) -> Result<&'a str, Invalid> {
    element.attribute(attribute).ok_or_else(|| foreign(element, format!("it needs the attribute {attribute}")))
}

/// Refuses a joint range, rad, other than −90° to 90°, which every imported joint has.
pub(super) fn quarter_turns(element: Node, range: Option<[f64; 2]>) -> Result<(), Invalid> {
    let quarter = std::f64::consts::FRAC_PI_2;
    let told = match range {
        Some([low, high]) if (low + quarter).abs() < 1e-3 && (high - quarter).abs() < 1e-3 => return Ok(()),
        Some([low, high]) => format!("it turns from {:.1}° to {:.1}°", low.to_degrees(), high.to_degrees()),
        None => "it has no limits".to_owned(),
    };
    Err(foreign(element, format!("{told}: only joints from -90° to 90° are allowed")))
}

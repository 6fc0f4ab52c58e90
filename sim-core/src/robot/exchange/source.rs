//! Reading XML: elements by the name a user knows them by, numbers, and refusals that say where.

use crate::error::Invalid;
use crate::limits::{MAX_TOML_LENGTH, MAX_XML_DEPTH};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use roxmltree::{Document, Node};

/// Largest magnitude of any number.
const LARGEST: f64 = 1e9;

/// A document that is not too long and not too deep.
pub(super) fn parse(text: &str) -> Result<Document<'_>, Invalid> {
    let length = text.len() as f64;
    crate::error::in_range("length of the robot's text", length, (0.0, MAX_TOML_LENGTH as f64), "bytes")?;
    let document = Document::parse(text).map_err(|e| Invalid::Syntax { message: format!("this is not XML: {e}") })?;
    let mut open = vec![(document.root_element(), 1)];
    while let Some((element, depth)) = open.pop() {
        if depth > MAX_XML_DEPTH {
            return Err(foreign(
                element,
                format!("it lies deeper than {MAX_XML_DEPTH} elements: that many are allowed"),
            ));
        }
        open.extend(children(element).map(|child| (child, depth + 1)));
    }
    Ok(document)
}

/// The elements in an element.
pub(super) fn children<'a>(element: Node<'a, 'a>) -> impl Iterator<Item = Node<'a, 'a>> {
    element.children().filter(Node::is_element)
}

/// Its tag.
pub(super) fn tag<'a>(element: Node<'a, 'a>) -> &'a str {
    element.tag_name().name()
}

/// The first child with this tag.
pub(super) fn child<'a>(element: Node<'a, 'a>, wanted: &str) -> Option<Node<'a, 'a>> {
    children(element).find(|c| tag(*c) == wanted)
}

/// A refusal of an element.
pub(super) fn foreign(element: Node, reason: impl Into<String>) -> Invalid {
    // What tells a user which one it is.
    let known = ["name", "class", "link", "joint", "file"];
    let own = known.iter().find_map(|a| Some(format!(" {a}=\"{}\"", element.attribute(*a)?)));
    let shortened = |text: String| text.chars().take(100).collect::<String>();
    Invalid::Foreign {
        line: element.document().text_pos_at(element.range().start).row,
        element: shortened(format!("<{}{}>", tag(element), own.unwrap_or_default())),
        reason: reason.into(),
    }
}

/// Refuses an element by the elements that may stand there.
pub(super) fn unknown(element: Node, allowed: &[&str]) -> Invalid {
    foreign(element, format!("this element can't be imported here: allowed are {}", allowed.join(", ")))
}

/// Finite numbers separated by spaces, as many as there are.
pub(super) fn numbers(element: Node, attribute: &str, text: &str) -> Result<Vec<f64>, Invalid> {
    let number = |word: &str| word.parse().ok().filter(|v: &f64| v.abs() <= LARGEST);
    text.split_whitespace().map(number).collect::<Option<Vec<f64>>>().ok_or_else(|| {
        let reason = format!("{attribute} = \"{text}\" is no list of numbers: numbers between ±{LARGEST:e} are needed");
        foreign(element, reason)
    })
}

/// Exactly N numbers.
pub(super) fn exactly<const N: usize>(element: Node, attribute: &str, text: &str) -> Result<[f64; N], Invalid> {
    numbers(element, attribute, text)?.try_into().map_err(|_| {
        let plural = if N == 1 { "number is" } else { "numbers are" };
        foreign(element, format!("{attribute} = \"{text}\": {N} {plural} needed"))
    })
}

/// Refuses a number, or several, of which one is not 0.
pub(super) fn zero(element: Node, attribute: &str, text: Option<&str>, why: &str) -> Result<(), Invalid> {
    let Some(text) = text else { return Ok(()) };
    if numbers(element, attribute, text)?.iter().all(|v| *v == 0.0) {
        return Ok(());
    }
    Err(foreign(element, format!("{attribute} = \"{text}\": only 0 is allowed, {why}")))
}

/// A rotation from w, x, y, z. What is of unit length to f32 keeps its bits.
pub(super) fn rotation(element: Node, [w, x, y, z]: [f64; 4]) -> Result<UnitQuaternion<f64>, Invalid> {
    let quaternion = Quaternion::new(w, x, y, z);
    let length = quaternion.norm();
    if length < 1e-6 {
        return Err(foreign(element, "a rotation of length 0: a unit quaternion w, x, y, z is needed"));
    }
    let unit = if (length - 1.0).abs() < 1e-6 { quaternion } else { quaternion / length };
    Ok(UnitQuaternion::new_unchecked(unit))
}

/// The turn about an axis, rad.
pub(super) fn turn(element: Node, axis: [f64; 3], angle: f64) -> Result<UnitQuaternion<f64>, Invalid> {
    let length = Vector3::from(axis).norm();
    if length < 1e-6 {
        return Err(foreign(element, "an axis has a direction: not all of it can be 0"));
    }
    let [x, y, z] = axis.map(|v| v / length * libm::sin(angle / 2.0));
    rotation(element, [libm::cos(angle / 2.0), x, y, z])
}

/// The joint range that every joint here has, rad; others are refused.
pub(super) fn quarter_turns(element: Node, range: Option<[f64; 2]>) -> Result<(), Invalid> {
    let quarter = std::f64::consts::FRAC_PI_2;
    let told = match range {
        Some([low, high]) if (low + quarter).abs() < 1e-3 && (high - quarter).abs() < 1e-3 => return Ok(()),
        Some([low, high]) => format!("it turns from {:.1}° to {:.1}°", low.to_degrees(), high.to_degrees()),
        None => "it has no limits".to_owned(),
    };
    Err(foreign(element, format!("{told}: only joints from -90° to 90° are allowed")))
}

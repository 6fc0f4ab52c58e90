//! Tests of the parser: the paper's segments, separators, every kind of error, random texts.

use super::super::samples::{mutated, pieces};
use super::*;
use crate::model::mtran::Angle;
use proptest::prelude::*;

fn degrees(first: i64, second: i64) -> [Angle; 2] {
    [first, second].map(|degrees| Angle::of_degrees(degrees).unwrap())
}

fn program_of(turns: Vec<Turn>, connections: Vec<Port>) -> Program {
    Program { items: vec![Item::Segment(Segment { turns, connections })] }
}

fn error_of(text: &str) -> String {
    parse(text).unwrap_err().to_string()
}

/// Segments (a), (b) and (c) of Fig. 3.
#[test]
fn segments_of_the_paper_parse() {
    let a = Turn { module: 1, base: 1, angles: degrees(0, -90) };
    let b = Turn { module: 1, base: 0, angles: degrees(90, 0) };
    let kept = Port { module: 1, part: 1, face: 0 };
    assert_eq!(parse("{ m [1 1] 0, -90 }"), Ok(program_of(vec![a], vec![])));
    assert_eq!(parse("{ m [1 0] 90, 0 }"), Ok(program_of(vec![b], vec![])));
    assert_eq!(parse("{ m [1 0] 90, 0 c [1 1] 0 }"), Ok(program_of(vec![b], vec![kept])));
}

#[test]
fn separators_do_not_change_the_program() {
    let expected = parse("L 3 { { m [1 1] 0, -90 c [1 1] 0 } }").unwrap();
    for text in [
        "L3{{m[1 1]0,-90 c[1 1]0}}",
        "L 3 {\n\t{ m [1, 1] 0°, −90° ; c [1,1] 0; }\r\n}\n",
        "# comment\nL # }\n3 { { # m [0 0]\nm [ 1 # one\n1 ] 0 ° ,\u{a0}-90\nc [01 1] 00 } } # end",
        "L 3 { { c [1 1] 0; m [1 1] 0, -90 } }",
    ] {
        assert_eq!(parse(text).as_ref(), Ok(&expected), "{text}");
    }
}

#[test]
fn empty_segment_is_allowed() {
    assert_eq!(parse("{}"), Ok(program_of(vec![], vec![])));
}

/// Texts with an error, and its message.
const ERRORS: &[(&str, &str)] = &[
    ("", r#"line 1, column 1: found the end of the text, expected a segment "{ … }" or a loop "L N { … }""#),
    (
        "# only a comment",
        r#"line 1, column 17: found the end of the text, expected a segment "{ … }" or a loop "L N { … }""#,
    ),
    ("x", r#"line 1, column 1: found "x", expected a segment "{ … }" or a loop "L N { … }""#),
    ("{} x", r#"line 1, column 4: found "x", expected a segment "{ … }", a loop "L N { … }" or the end of the text"#),
    ("{} }", r#"line 1, column 4: found "}", expected a segment "{ … }", a loop "L N { … }" or the end of the text"#),
    ("L", "line 1, column 2: found the end of the text, expected a number of repeats: a whole number from 1 to 1000"),
    ("L 0 { {} }", r#"line 1, column 3: found "0", expected a number of repeats: a whole number from 1 to 1000"#),
    ("L 1001 { {} }", r#"line 1, column 3: found "1001", expected a number of repeats: a whole number from 1 to 1000"#),
    ("L 3 m", r#"line 1, column 5: found "m", expected "{" after the number of repeats"#),
    (
        "L 3 {}",
        "line 1, column 6: found \"}\", expected at least one segment \"{ … }\" or loop \"L N { … }\" before \
         the \"}\" that closes the \"{\" at line 1, column 5",
    ),
    (
        "L 3 {",
        "line 1, column 6: found the end of the text, expected at least one segment \"{ … }\" or loop \"L N \
         { … }\" before the \"}\" that closes the \"{\" at line 1, column 5",
    ),
    (
        "L 2 { L 3 {{}}",
        "line 1, column 15: found the end of the text, expected a segment \"{ … }\", a loop \"L N { … }\" or \
         the \"}\" that closes the \"{\" at line 1, column 5",
    ),
    (
        "L 3 {{}; {}}",
        "line 1, column 8: found \";\", expected a segment \"{ … }\", a loop \"L N { … }\" or the \"}\" that \
         closes the \"{\" at line 1, column 5",
    ),
    (
        "{ m [1 1] 0, 90\n\nL 3 { {} }",
        "line 3, column 1: found \"L\", expected an operation \"m [ID base] θ0, θ1\" or \"c [ID part] \
         face\", or the \"}\" that closes the \"{\" at line 1, column 1",
    ),
    (
        "{ m [1 1] 0, 0 } {",
        "line 1, column 19: found the end of the text, expected an operation \"m [ID base] θ0, θ1\" or \"c \
         [ID part] face\", or the \"}\" that closes the \"{\" at line 1, column 18",
    ),
    (
        "{ x }",
        "line 1, column 3: found \"x\", expected an operation \"m [ID base] θ0, θ1\" or \"c [ID part] \
         face\", or the \"}\" that closes the \"{\" at line 1, column 1",
    ),
    (
        "{ m [1 1] 0, 0;; }",
        "line 1, column 16: found \";\", expected an operation \"m [ID base] θ0, θ1\" or \"c [ID part] \
         face\", or the \"}\" that closes the \"{\" at line 1, column 1",
    ),
    ("{ m 1 1", r#"line 1, column 5: found "1", expected "[" before the number of the module"#),
    ("{ m [256 1]", r#"line 1, column 6: found "256", expected the number of a module: a whole number from 0 to 255"#),
    ("{ m [-1 1]", r#"line 1, column 6: found "-1", expected the number of a module: a whole number from 0 to 255"#),
    ("{ m [1 2] 0, 0 }", r#"line 1, column 8: found "2", expected the base part of the module: 0 or 1"#),
    ("{ m [11] 0, 0 }", r#"line 1, column 8: found "]", expected the base part of the module: 0 or 1"#),
    ("{ c [1 2] 0 }", r#"line 1, column 8: found "2", expected a part of the module: 0 or 1"#),
    ("{ m [1 1 0, 0 }", r#"line 1, column 10: found "0", expected "]" after the part"#),
    (
        "{ m [1 1]\n  0, 45 }",
        r#"line 2, column 6: found "45", expected an angle: a multiple of 30 degrees from -90 to 90"#,
    ),
    (
        "{ m [1 1] −120°, 0 }",
        r#"line 1, column 11: found "−120", expected an angle: a multiple of 30 degrees from -90 to 90"#,
    ),
    (
        "{ m [1 1] 0, 0c [1 1] 0 }",
        r#"line 1, column 14: found "0c", expected an angle: a multiple of 30 degrees from -90 to 90"#,
    ),
    ("{ m [1 1] 0 0 }", r#"line 1, column 13: found "0", expected "," between the two angles"#),
    ("{ c [1 1] 3 }", r#"line 1, column 11: found "3", expected a face: 0, 1 or 2"#),
    (
        "{ m [1 1] 0, 0 m [1 0] 0, 0 }",
        r#"line 1, column 19: found "1", expected another module: a segment can turn a module only once"#,
    ),
    (
        "{ c [1 1] 0 c [1 0] 0 c [1 1] 0 }",
        r#"line 1, column 31: found "0", expected another face: a segment can name a face only once"#,
    ),
    (
        "{ {} }",
        "line 1, column 3: found \"{\", expected an operation \"m [ID base] θ0, θ1\" or \"c [ID part] \
         face\", or the \"}\" that closes the \"{\" at line 1, column 1",
    ),
    (
        "L 1000 { L 11 { {} } }",
        "line 1, column 1: found \"L\", expected fewer segments: with all loops unrolled there can be at \
         most 10000",
    ),
    (
        "L 1000 { L 10 { {} } } {}",
        "line 1, column 24: found \"{\", expected fewer segments: with all loops unrolled there can be at \
         most 10000",
    ),
];

#[test]
fn errors_name_the_place_and_the_expected_text() {
    for (text, message) in ERRORS {
        assert_eq!(error_of(text), *message, "{text}");
    }
}

#[test]
fn text_beyond_its_greatest_length_is_rejected() {
    let text = format!("{{}}{}", " ".repeat(MAX_PROGRAM_LENGTH - 2));
    assert!(parse(&text).is_ok());
    let message = "line 1, column 65537: found \"{\", expected the end of the text: it can have at most 65536 bytes";
    assert_eq!(error_of(&(text + "{}")), message);
    let wide = format!("{}{{}}", "é".repeat(MAX_PROGRAM_LENGTH / 2));
    assert_eq!(error_of(&wide).split(':').next(), Some("line 1, column 32769"));
}

#[test]
fn program_beyond_its_greatest_printed_length_is_rejected() {
    let operations: String = (0..=MAX_MODULE).map(|module| format!("m[{module} 0]0,0;")).collect();
    let text = format!("{{{operations}}}").repeat(20);
    assert!(text.len() <= MAX_PROGRAM_LENGTH);
    let message = "line 1, column 1: found \"{\", expected a shorter program: \
         with its spaces it has 74679 bytes, at most 65536 are allowed";
    assert_eq!(error_of(&text), message);
}

#[test]
fn items_beyond_their_greatest_number_are_rejected() {
    let text = format!("L 1 {{{}}}", "{}".repeat(MAX_ITEMS - 1));
    assert!(parse(&text).is_ok());
    let message = "line 1, column 2005: found \"L\", \
         expected no further item: a text can have at most 1000 segments and loops";
    assert_eq!(error_of(&(text + "L 1 {{}}")), message);
}

/// The stack is smaller than that of any thread, and the text as deep as a text can be.
#[test]
fn loops_beyond_their_greatest_depth_are_rejected() {
    let message = "line 1, column 33: found \"L\", \
         expected a segment \"{ … }\" or the \"}\": loops can be nested at most 8 deep";
    let deep = "L 1{".repeat(MAX_PROGRAM_LENGTH / 4);
    let thread = std::thread::Builder::new().stack_size(256 * 1024);
    assert_eq!(thread.spawn(move || error_of(&deep)).unwrap().join().unwrap(), message);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 10_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_do_not_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = parse(&String::from_utf8_lossy(&bytes));
    }

    #[test]
    fn random_pieces_do_not_panic(text in pieces()) {
        let _ = parse(&text);
    }

    #[test]
    fn mutated_program_parses_or_names_a_place_in_the_text(text in mutated()) {
        match parse(&text) {
            Ok(program) => prop_assert_eq!(parse(&program.to_string()), Ok(program)),
            Err(error) => {
                let line = text.split('\n').nth(error.line - 1).unwrap();
                let (start, _) = line.char_indices().nth(error.column - 1).unwrap_or((line.len(), ' '));
                prop_assert!(error.column <= line.chars().count() + 1);
                prop_assert!(line[start..].starts_with(error.found.trim_end_matches('…')));
            }
        }
    }
}

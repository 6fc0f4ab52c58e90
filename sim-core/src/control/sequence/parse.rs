//! Parser of motion sequences (Yoshida et al. 2003, section 2.2 B).
//!
//! ```text
//! program   = item { item }
//! item      = segment | loop
//! segment   = "{" { operation [ ";" ] } "}"
//! loop      = "L" times "{" item { item } "}"
//! operation = "m" "[" module [ "," ] base "]" angle "," angle
//!           | "c" "[" module [ "," ] part "]" face
//! angle     = [ "-" | "−" ] degrees [ "°" ]
//! ```
//!
//! White space and comments, from `#` to the end of the line, may stand between any two words of the grammar. They must
//! stand between two numbers and between a number and a letter after it, if no symbol does.

use super::parse_error::{Expected, ParseError, ends_word};
use super::program::{
    Item, MAX_DEPTH, MAX_ITEMS, MAX_MODULE, MAX_PROGRAM_LENGTH, MAX_SEGMENTS, MAX_TIMES, Program, Segment, Turn,
};
use crate::model::mtran::{Angle, Port};
use std::ops::RangeInclusive;
use winnow::combinator::{alt, cut_err, eof, not, opt, peek, preceded, repeat, separated_pair, terminated};
use winnow::error::{AddContext, ErrMode, ParserError};
use winnow::prelude::*;
use winnow::stream::{Location, Stream};
use winnow::token::{one_of, take_till, take_while};
use winnow::{LocatingSlice, Stateful};

/// Parses a program.
///
/// # Errors
/// The first place where the text breaks the grammar or a limit, such as [`MAX_ITEMS`]. A program is also
/// rejected if a loop or the program has no items, if a segment turns a module twice or names a face twice, or if its
/// printed form has more than [`MAX_PROGRAM_LENGTH`] bytes.
pub fn parse(text: &str) -> Result<Program, ParseError> {
    if text.len() > MAX_PROGRAM_LENGTH {
        let end = text.floor_char_boundary(MAX_PROGRAM_LENGTH);
        return Err(ParseError::new(text, end, Expected::ShorterText, None));
    }
    let mut input = Stateful { input: LocatingSlice::new(text), state: State::default() };
    let items = preceded(blank, |input: &mut Input<'_>| items(input, Expected::Item));
    let program = terminated(items, eof.context(Expected::ItemOrEnd)).parse_next(&mut input).map_err(|error| {
        let fault = error.into_inner().unwrap_or_else(|_| Fault::at(&input));
        let expected = fault.expected.unwrap_or(Expected::ItemOrEnd);
        ParseError::new(text, fault.at, expected, input.state.opened.last().copied())
    })?;
    let program = Program { items: program };
    let printed = program.to_string().len();
    if printed > MAX_PROGRAM_LENGTH {
        return Err(ParseError::new(text, 0, Expected::ShorterProgram { printed }, None));
    }
    Ok(program)
}

/// Text that is still to be parsed.
type Input<'a> = Stateful<LocatingSlice<&'a str>, State>;

/// Result of a part of the grammar. A fault that backtracks means that the part does not begin here.
type Parsed<T> = ModalResult<T, Fault>;

/// State of the parser.
#[derive(Clone, Debug, Default)]
struct State {
    /// Bytes of the braces that are not closed yet, the outermost first.
    opened: Vec<usize>,
    /// Number of items so far, at any depth.
    items: usize,
}

/// Place where the text is not as expected.
#[derive(Clone, Debug)]
struct Fault {
    /// Byte of the place.
    at: usize,
    /// Text that is allowed there. The innermost part of the grammar that names it decides.
    expected: Option<Expected>,
}

impl Fault {
    /// Returns a fault at the next byte.
    fn at(input: &Input<'_>) -> Self {
        Self { at: input.current_token_start(), expected: None }
    }

    /// Returns a fault that ends the parsing.
    fn cut(at: usize, expected: Expected) -> ErrMode<Self> {
        ErrMode::Cut(Self { at, expected: Some(expected) })
    }
}

impl<'a> ParserError<Input<'a>> for Fault {
    type Inner = Self;

    fn from_input(input: &Input<'a>) -> Self {
        Self::at(input)
    }

    fn into_inner(self) -> Result<Self, Self> {
        Ok(self)
    }
}

impl<'a> AddContext<Input<'a>, Expected> for Fault {
    fn add_context(self, _: &Input<'a>, _: &<Input<'a> as Stream>::Checkpoint, expected: Expected) -> Self {
        Self { expected: self.expected.or(Some(expected)), ..self }
    }
}

/// Parses items as long as there are any, at least one. `first` describes the first one.
fn items(input: &mut Input<'_>, first: Expected) -> Parsed<Vec<Item>> {
    let mut items = Vec::new();
    let mut segments = 0;
    loop {
        let at = input.current_token_start();
        let Some(item) = opt(item).parse_next(input)? else { break };
        segments += item.count();
        if segments > MAX_SEGMENTS {
            return Err(Fault::cut(at, Expected::FewerSegments));
        }
        items.push(item);
    }
    if items.is_empty() {
        return Err(Fault::cut(input.current_token_start(), first));
    }
    Ok(items)
}

/// Parses a segment or a loop.
fn item(input: &mut Input<'_>) -> Parsed<Item> {
    let at = input.current_token_start();
    let first = peek(alt((letter('L'), symbol('{')))).parse_next(input)?;
    input.state.items += 1;
    if input.state.items > MAX_ITEMS {
        return Err(Fault::cut(at, Expected::FewerItems));
    }
    if first == '{' {
        return segment.map(Item::Segment).parse_next(input);
    }
    // Only loops hold items, so that all braces that are open here are loops.
    if input.state.opened.len() >= MAX_DEPTH {
        return Err(Fault::cut(at, Expected::LowerDepth));
    }
    preceded(letter('L'), repeated).parse_next(input)
}

/// Parses a loop after its letter.
fn repeated(input: &mut Input<'_>) -> Parsed<Item> {
    let times = number(1..=MAX_TIMES, Expected::Times).parse_next(input)?;
    open(input)?;
    let items = items(input, Expected::LoopItem)?;
    close(input, Expected::ItemOrClose)?;
    Ok(Item::Loop { times, items })
}

/// Parses a segment.
fn segment(input: &mut Input<'_>) -> Parsed<Segment> {
    open(input)?;
    let mut segment = Segment::default();
    while opt(|input: &mut Input<'_>| operation(input, &mut segment)).parse_next(input)?.is_some() {
        opt(symbol(';')).parse_next(input)?;
    }
    close(input, Expected::OperationOrClose)?;
    Ok(segment)
}

/// Parses an operation and adds it to a segment.
fn operation(input: &mut Input<'_>, segment: &mut Segment) -> Parsed<()> {
    match alt((letter('m'), letter('c'))).parse_next(input)? {
        'm' => turn(input, &mut segment.turns),
        _ => connection(input, &mut segment.connections),
    }
}

/// Parses a turn after its letter.
fn turn(input: &mut Input<'_>, turns: &mut Vec<Turn>) -> Parsed<()> {
    let (at, module, base) = part(input, Expected::Base)?;
    if turns.iter().any(|turn| turn.module == module) {
        return Err(Fault::cut(at, Expected::OtherModule));
    }
    let comma = required(symbol(','), Expected::Comma);
    let (first, second) = separated_pair(angle, comma, angle).parse_next(input)?;
    turns.push(Turn { module, base, angles: [first, second] });
    Ok(())
}

/// Parses a connection after its letter.
fn connection(input: &mut Input<'_>, connections: &mut Vec<Port>) -> Parsed<()> {
    let (_, module, part) = part(input, Expected::Part)?;
    let at = input.current_token_start();
    let port = number(0..=2, Expected::Face).map(|face| Port { module, part, face }).parse_next(input)?;
    if connections.contains(&port) {
        return Err(Fault::cut(at, Expected::OtherFace));
    }
    connections.push(port);
    Ok(())
}

/// Parses a module and its part in brackets. Returns the byte of the module, the module and the part.
fn part(input: &mut Input<'_>, expected: Expected) -> Parsed<(usize, u32, u8)> {
    required(symbol('['), Expected::OpenBracket).parse_next(input)?;
    let at = input.current_token_start();
    let module = number(0..=MAX_MODULE, Expected::Module);
    let (module, part) = separated_pair(module, opt(symbol(',')), number(0..=1, expected)).parse_next(input)?;
    required(symbol(']'), Expected::CloseBracket).parse_next(input)?;
    Ok((at, module, part))
}

/// Parses an angle in degrees.
fn angle(input: &mut Input<'_>) -> Parsed<Angle> {
    let angle = word.verify_map(|word| {
        let digits = word.strip_prefix(['-', '−']);
        let degrees = i64::from(whole(digits.unwrap_or(word))?);
        Angle::of_degrees(if digits.is_some() { -degrees } else { degrees })
    });
    required(terminated(angle, opt(symbol('°'))), Expected::Angle).parse_next(input)
}

/// Parser of a whole number in a range.
fn number<'a, T>(range: RangeInclusive<u32>, expected: Expected) -> impl Parser<Input<'a>, T, ErrMode<Fault>>
where
    T: TryFrom<u32>,
{
    let value = move |word| whole(word).filter(|value| range.contains(value)).and_then(|value| T::try_from(value).ok());
    required(word.verify_map(value), expected)
}

/// Returns the value of a word of decimal digits; `None` for other words and beyond 32 bits.
fn whole(word: &str) -> Option<u32> {
    word.parse().ok().filter(|_| !word.starts_with('+'))
}

/// Parses an opening brace.
fn open(input: &mut Input<'_>) -> Parsed<()> {
    let at = input.current_token_start();
    required(symbol('{'), Expected::Open).parse_next(input)?;
    input.state.opened.push(at);
    Ok(())
}

/// Parses the closing brace of the innermost brace that is open. `expected` describes it and its alternatives.
fn close(input: &mut Input<'_>, expected: Expected) -> Parsed<()> {
    required(symbol('}'), expected).parse_next(input)?;
    input.state.opened.pop();
    Ok(())
}

/// Parser of a part of the grammar that must stand here.
fn required<'a, T>(
    part: impl Parser<Input<'a>, T, ErrMode<Fault>>,
    expected: Expected,
) -> impl Parser<Input<'a>, T, ErrMode<Fault>> {
    cut_err(part).context(expected)
}

/// Parser of a letter that no letter follows, and of the blank after it.
fn letter<'a>(letter: char) -> impl Parser<Input<'a>, char, ErrMode<Fault>> {
    terminated(letter, (not(one_of(char::is_alphabetic)), blank))
}

/// Parser of a symbol and the blank after it.
fn symbol<'a>(symbol: char) -> impl Parser<Input<'a>, char, ErrMode<Fault>> {
    terminated(symbol, blank)
}

/// Parses the characters up to the next white space or symbol, and the blank after them.
fn word<'a>(input: &mut Input<'a>) -> Parsed<&'a str> {
    terminated(take_till(1.., ends_word), blank).parse_next(input)
}

/// Skips white space and comments.
fn blank(input: &mut Input<'_>) -> Parsed<()> {
    let comment = ('#', take_till(0.., '\n')).void();
    repeat(0.., alt((take_while(1.., char::is_whitespace).void(), comment))).parse_next(input)
}

#[cfg(test)]
mod tests;

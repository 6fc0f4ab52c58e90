//! Output for people: printing, and formats of numbers and times.

use crate::error::Error;
use serde::Serialize;
use std::io::{self, Write as _};
use std::path::Path;
use std::time::Duration;

/// Prints one or more lines to standard output.
pub fn say(text: &str) -> Result<(), Error> {
    let mut out = io::stdout().lock();
    let end = if text.ends_with('\n') { "" } else { "\n" };
    write!(out, "{text}{end}").and_then(|()| out.flush()).map_err(|error| match error.kind() {
        io::ErrorKind::BrokenPipe => Error::OutputClosed,
        _ => Error::write(Path::new("standard output"), error),
    })
}

/// Prints a value as indented JSON, for scripts.
pub fn say_json(value: &impl Serialize) -> Result<(), Error> {
    say(&json(value)?)
}

/// Prints a value as one line of JSON, for streams of values.
pub fn say_json_line(value: &impl Serialize) -> Result<(), Error> {
    say(&serde_json::to_string(value).map_err(|e| Error::write(Path::new("standard output"), e.into()))?)
}

/// Formats a value as indented JSON.
pub fn json(value: &impl Serialize) -> Result<String, Error> {
    serde_json::to_string_pretty(value).map_err(|e| Error::write(Path::new("standard output"), e.into()))
}

/// Prints a line to standard error. Errors are ignored: standard error may be closed.
pub fn note(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// Prints a warning to standard error.
pub fn warn(text: &str) {
    note(&format!("warning: {text}"));
}

/// Quotes a path or name for a POSIX shell, so that a command reads it as one argument and not as an option.
pub fn quoted(word: impl std::fmt::Display) -> String {
    let word = word.to_string();
    let word = if word.starts_with('-') { format!("./{word}") } else { word };
    let plain = |c: char| c.is_alphanumeric() || "-_./:,+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
}

/// Formats rows as left-aligned columns under a head. Cells are printed as given.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count());
        cells.chain([head[column].chars().count()]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let line = |cells: Vec<&str>| {
        let padded = cells.iter().zip(&widths).map(|(cell, &width)| format!("{cell:width$}"));
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    let lines = std::iter::once(line(head.to_vec()))
        .chain(rows.iter().map(|row| line(row.iter().map(String::as_str).collect())));
    lines.collect::<Vec<_>>().join("\n")
}

/// Formats 1234567 as "1,234,567".
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// Formats a duration with one or two units: "0.42 s", "12 s", "2 min 41 s", "3 h 5 min", "2 d 4 h".
pub fn duration(d: Duration) -> String {
    let s = d.as_secs_f64();
    let whole = s.round() as u64;
    match whole {
        0..=9 => format!("{s:.2} s"),
        10..=59 => format!("{whole} s"),
        60..=3599 => format!("{} min {} s", whole / 60, whole % 60),
        3600..=86_399 => format!("{} h {} min", whole / 3600, whole % 3600 / 60),
        _ => format!("{} d {} h", whole / 86_400, whole % 86_400 / 3600),
    }
}

/// Formats a duration in seconds; "?" for a negative, huge or infinite one.
pub fn seconds(s: f64) -> String {
    if s.is_finite() && (0.0..1e12).contains(&s) { duration(Duration::from_secs_f64(s)) } else { "?".to_owned() }
}

/// Formats a score with four significant digits: "34.29", "0.01235".
pub fn score(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let magnitude = value.abs().log10().floor() as i32;
    let decimals = (3 - magnitude).clamp(0, 12) as usize;
    format!("{value:.decimals$}")
}

/// Formats a score with its unit; "–" for none.
pub fn score_with(value: Option<f64>, unit: &str) -> String {
    match value {
        Some(v) if unit.is_empty() => score(v),
        Some(v) => format!("{} {unit}", score(v)),
        None => "–".to_owned(),
    }
}

/// Formats a Unix time in ms as "2026-11-22 00:47:15" (UTC); "–" for 0 or less.
pub fn moment(unix_ms: i64) -> String {
    if unix_ms <= 0 {
        return "–".to_owned();
    }
    let seconds = unix_ms / 1000;
    let (days, second) = (seconds / 86_400, seconds % 86_400);
    // Converts days to a calendar date, in eras of 400 years that begin in March.
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = era * 400 + year_of_era + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02} {:02}:{:02}:{:02}", second / 3600, second % 3600 / 60, second % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unix_times_are_formatted_as_calendar_dates() {
        assert_eq!(moment(951_782_400_000), "2000-02-29 00:00:00");
        assert_eq!(moment(1_795_308_435_999), "2026-11-22 00:47:15");
        assert_eq!(moment(1_000), "1970-01-01 00:00:01");
        assert_eq!(moment(0), "–");
    }

    #[test]
    fn numbers_and_durations_are_formatted_for_people() {
        assert_eq!(count(0), "0");
        assert_eq!(count(999), "999");
        assert_eq!(count(1_234_567), "1,234,567");
        assert_eq!(score(34.285_71), "34.29");
        assert_eq!(score(-0.012_345_6), "-0.01235");
        assert_eq!(score(12_345.6), "12346");
        assert_eq!(score(0.0), "0");
        assert_eq!(duration(Duration::from_millis(420)), "0.42 s");
        assert_eq!(duration(Duration::from_secs(161)), "2 min 41 s");
        assert_eq!(duration(Duration::from_secs(11_100)), "3 h 5 min");
        assert_eq!(seconds(f64::INFINITY), "?");
    }

    #[test]
    fn shell_reads_quoted_word_unchanged() {
        for plain in ["runs/a-1.toml", "j1-0123456789ab", "/x/y", "lizard", "große", "https://a:1,https://b:2"] {
            assert_eq!(quoted(plain), plain);
        }
        for odd in [
            "my runs/a",
            "it's",
            "$HOME",
            "a;b",
            "a\nb",
            "`x`",
            "\"q\"",
            "*",
            "~",
            "#a",
            "a\\b",
            "(x)",
            "",
            "a&b",
            "!x",
            "''",
        ] {
            let command = format!("printf %s {}", quoted(odd));
            let seen = std::process::Command::new("sh").args(["-c", &command]).output().unwrap();
            assert_eq!(String::from_utf8(seen.stdout).unwrap(), odd);
        }
        assert_eq!(quoted("-rf"), "./-rf");
    }

    #[test]
    fn table_columns_are_aligned_with_heads() {
        let rows = vec![vec!["a".into(), "long".into(), "x".into()], vec!["bcd".into(), "s".into(), String::new()]];
        assert_eq!(table(&["id", "n", "note"], &rows), "id   n     note\na    long  x\nbcd  s");
    }
}

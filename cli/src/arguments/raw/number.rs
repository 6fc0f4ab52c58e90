//! Parsers of numbers on the command line. Each error states the allowed values.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Returns a parser of whole numbers in this range.
pub fn whole(allowed: RangeInclusive<u32>) -> impl Fn(&str) -> Result<u32, String> + Clone + Send + Sync {
    among(allowed)
}

/// Returns a parser of seeds in the range of a job's seed.
pub fn seed() -> impl Fn(&str) -> Result<u64, String> + Clone + Send + Sync {
    among(0..=sim_core::base::limits::MAX_SEED)
}

fn among<T>(allowed: RangeInclusive<T>) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync
where
    T: FromStr + PartialOrd + Display + Clone + Send + Sync,
{
    move |typed| {
        let number = typed.parse().ok().filter(|number| allowed.contains(number));
        number.ok_or_else(|| format!("whole numbers from {} to {} are allowed", allowed.start(), allowed.end()))
    }
}

/// Parses the duration of a gait, s.
pub fn duration(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|_| "it is not a number of seconds".to_owned())?;
    let ticks = seconds / sim_core::physics::TICK;
    if !(0.1..=sim_core::base::limits::MAX_DURATION).contains(&seconds) {
        Err(format!("allowed is 0.1 to {} s", sim_core::base::limits::MAX_DURATION))
    } else if (ticks - ticks.round()).abs() > 1e-6 {
        Err("it must be a multiple of 0.005 s".to_owned())
    } else {
        Ok(seconds)
    }
}

/// Parses a range, such as `0.6..1.0`, or a single number.
pub fn range(text: &str) -> Result<[f64; 2], String> {
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    let (low, high) = text.split_once("..").unwrap_or((text, text));
    match (number(low), number(high)) {
        (Some(low), Some(high)) if low <= high => Ok([low, high]),
        (Some(low), Some(high)) => Err(format!("the range begins at {low}, above its end {high}")),
        _ => Err("a range is two numbers with two dots between them, such as 0.6..1.0, or one number".to_owned()),
    }
}

/// Parses a length that all lengths of a file are divided by.
pub fn length(text: &str) -> Result<f64, String> {
    let length: f64 = text.parse().map_err(|_| "it is not a number".to_owned())?;
    if (1e-6..=1e6).contains(&length) { Ok(length) } else { Err("allowed is 0.000001 to 1000000".to_owned()) }
}

/// Parses a tolerance in the range of `planner.reuse_tolerance`, rad.
pub fn tolerance(text: &str) -> Result<f64, String> {
    let tolerance: f64 = text.parse().map_err(|_| "it is not a number".to_owned())?;
    if (0.0..=1.0).contains(&tolerance) { Ok(tolerance) } else { Err("allowed is 0 to 1 rad".to_owned()) }
}

//! Parsers of times on the command line.

use proto::limits::MAX_TIME;
use std::time::Duration;

/// Parses seconds, such as `10` or `0.5`.
pub fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 =
        text.parse().map_err(|_| format!("'{text}' is not a number: give seconds, such as 10 or 0.5"))?;
    let out_of_range = |_| format!("'{text}' is out of range: give 0 to {} seconds", MAX_TIME.as_secs());
    Duration::try_from_secs_f64(seconds).map_err(out_of_range)
}

/// Parses seconds, or the time left that Slurm prints: `[DAYS-]HOURS:MINUTES:SECONDS` or `MINUTES:SECONDS`.
pub fn slurm(text: &str) -> Result<Duration, String> {
    if text.parse::<f64>().is_ok() {
        return seconds(text);
    }
    let wrong = || format!("'{text}' is not a time: give seconds or [DAYS-]HOURS:MINUTES:SECONDS");
    let number = |text: &str| text.parse::<u32>().map(u64::from).map_err(|_| wrong());
    let (days, clock) = match text.split_once('-') {
        Some((days, clock)) => (number(days)?, clock),
        None => (0, text),
    };
    let parts = clock.split(':').map(number).collect::<Result<Vec<u64>, String>>()?;
    let of_day = match parts[..] {
        [hours, minutes, seconds] => 3600 * hours + 60 * minutes + seconds,
        [minutes, seconds] if !text.contains('-') => 60 * minutes + seconds,
        _ => return Err(wrong()),
    };
    Ok(Duration::from_secs(86_400 * days + of_day))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slurm_time_is_parsed_and_invalid_text_refused() {
        for (text, seconds) in
            [("90", 90), ("1:30", 90), ("2:00:01", 7201), ("1-00:00:00", 86_400), ("3-04:05:06", 273_906)]
        {
            assert_eq!(slurm(text), Ok(Duration::from_secs(seconds)), "{text}");
        }
        for text in ["", "UNLIMITED", "1:2:3:4", "1-2:3", "-5", "1:x", "NaN"] {
            assert!(slurm(text).is_err(), "{text}");
        }
    }
}

//! SIGHUP: the terminal has gone. Under `nohup` it is ignored, and stays so.

use std::io;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// Listens for SIGHUP.
pub struct Hangup(Option<Signal>);

impl Hangup {
    /// Begins to listen, unless the process was started with the signal ignored, or the system does not show whether it was.
    pub fn listen() -> io::Result<Self> {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        Ok(Self(if is_ignored(&status) { None } else { Some(signal(SignalKind::hangup())?) }))
    }

    /// Returns when the signal comes; never where it is ignored.
    pub async fn recv(&mut self) {
        match &mut self.0 {
            Some(signal) => {
                signal.recv().await;
            }
            None => std::future::pending().await,
        }
    }
}

/// Returns true if the first signal, SIGHUP, is among the ignored ones in a `/proc/PID/status`.
fn is_ignored(status: &str) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_none_or(|mask| mask & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::is_ignored;

    #[test]
    fn ignored_hangup_is_read_from_the_mask() {
        assert!(is_ignored("Name:\tx\nSigIgn:\t0000000000001001\n"));
        assert!(!is_ignored("Name:\tx\nSigIgn:\t0000000000001000\n"));
        assert!(is_ignored("") && is_ignored("SigIgn:\tx"));
    }
}

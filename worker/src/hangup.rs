//! SIGHUP, sent when the terminal closes. Under `nohup` the signal is ignored, and stays ignored.

use std::io;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// Receiver of SIGHUP.
pub struct Hangup(Option<Signal>);

impl Hangup {
    /// Starts to receive the signal, unless the process was started with the signal ignored or `/proc` does not show
    /// it.
    pub fn listen() -> io::Result<Self> {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        Ok(Self(if is_ignored(&status) { None } else { Some(signal(SignalKind::hangup())?) }))
    }

    /// Waits for the signal; never returns where it is ignored.
    pub async fn recv(&mut self) {
        match &mut self.0 {
            Some(signal) => {
                signal.recv().await;
            }
            None => std::future::pending().await,
        }
    }
}

/// Returns true if a `/proc/PID/status` lists signal 1 (SIGHUP) as ignored, or lists no ignored signals.
fn is_ignored(status: &str) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_none_or(|mask| mask & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::is_ignored;

    #[test]
    fn ignored_sighup_is_read_from_signal_mask() {
        assert!(is_ignored("Name:\tx\nSigIgn:\t0000000000001001\n"));
        assert!(!is_ignored("Name:\tx\nSigIgn:\t0000000000001000\n"));
        assert!(is_ignored("") && is_ignored("SigIgn:\tx"));
    }
}

//! Signals that stop a command: Ctrl-C, SIGTERM (which cluster managers send before SIGKILL) and SIGHUP (the terminal
//! was closed).

use tokio::sync::watch;

/// Stop request by a signal. Clones share it, so any number of tasks can wait for it.
#[derive(Clone)]
pub struct Interrupt(watch::Receiver<bool>);

impl Interrupt {
    /// Starts listening. A second signal ends the process at once.
    pub fn listen() -> Self {
        let (sender, receiver) = watch::channel(false);
        tokio::spawn(async move {
            next_signal().await;
            // The send fails if all receivers were dropped: then there is nothing to stop.
            let _ = sender.send(true);
            next_signal().await;
            std::process::exit(130);
        });
        Self(receiver)
    }

    /// Waits for a signal.
    pub async fn wait(&self) {
        let mut receiver = self.0.clone();
        if receiver.wait_for(|stop| *stop).await.is_err() {
            // The listening task ended with its runtime: no signal will arrive.
            std::future::pending::<()>().await;
        }
    }
}

#[cfg(unix)]
async fn next_signal() {
    use tokio::signal::unix::{SignalKind, signal};
    match (signal(SignalKind::terminate()), worker::Hangup::listen()) {
        (Ok(mut terminate), Ok(mut hangup)) => {
            tokio::select! {
                _ = tokio::signal::ctrl_c() => {}
                _ = terminate.recv() => {}
                () = hangup.recv() => {}
            }
        }
        _ => {
            let _ = tokio::signal::ctrl_c().await;
        }
    }
}

#[cfg(not(unix))]
async fn next_signal() {
    let _ = tokio::signal::ctrl_c().await;
}

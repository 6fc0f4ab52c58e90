//! Ctrl-C, the request to terminate, as cluster managers send it before they kill, and the end of the terminal.

use tokio::sync::watch;

/// Tells, to any number of listeners, whether the user or the system wants us to stop.
#[derive(Clone)]
pub struct Interrupt(watch::Receiver<bool>);

impl Interrupt {
    /// Begins to listen. A second signal ends the process at once.
    pub fn listen() -> Self {
        let (sender, receiver) = watch::channel(false);
        tokio::spawn(async move {
            next_signal().await;
            // Nobody may be listening any more: then there is nothing to stop.
            let _ = sender.send(true);
            next_signal().await;
            std::process::exit(130);
        });
        Self(receiver)
    }

    /// Returns once a signal came.
    pub async fn wait(&self) {
        let mut receiver = self.0.clone();
        if receiver.wait_for(|stop| *stop).await.is_err() {
            // The listening task is gone with its runtime; there will be no signal.
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

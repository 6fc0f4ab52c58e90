//! What reads the bytes of strangers and of stores, for fuzzing: each must answer any bytes with a value or an error.

use crate::api;
use crate::limits::DEFAULT_LEASE;
use crate::scheduler::{Now, Scheduler, Settings};
use crate::store;
use proto::v1;
use std::collections::BTreeSet;
use std::time::Duration;

/// A worker's introduction, and what a coordinator that has run for a while makes of it.
pub fn hello(bytes: &[u8]) {
    let Ok(hello) = <v1::Hello as prost::Message>::decode(bytes) else { return };
    if let Ok(greeting) = api::check_hello(hello, String::new()) {
        let mut scheduler = Scheduler::new(Settings::new(1, DEFAULT_LEASE), 1, BTreeSet::new());
        let at = |seconds| Now { since_start: Duration::from_secs(seconds), unix_ms: 0 };
        let worker = greeting.worker.clone();
        let welcome = scheduler.connect(at(3600), greeting);
        scheduler.heartbeat(at(3601), &worker, welcome.session, &welcome.keep, &[]);
        scheduler.tick(at(7200));
    }
}

/// A worker's result.
pub fn complete(bytes: &[u8]) {
    if let Ok(request) = <v1::CompleteRequest as prost::Message>::decode(bytes) {
        let _ = api::check_completed(request);
    }
}

/// What a store holds of jobs, results and scores.
pub fn blob(bytes: &[u8]) {
    store::decode_anything(bytes);
}

/// The file of tokens.
pub fn tokens(text: &str) {
    if let Ok(access) = crate::Access::parse(text) {
        assert!(access.count() > 0);
    }
}

/// `--store`.
pub fn store_url(text: &str) {
    if let Ok(url) = text.parse::<crate::StoreUrl>() {
        // Written out it says the same.
        let _ = url.to_string();
    }
}

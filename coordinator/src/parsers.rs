//! What reads the bytes of strangers and of stores, for fuzzing: each must answer any bytes with a value or an error.

use crate::api;
use crate::limits::DEFAULT_LEASE;
use crate::permit::PermitKey;
use crate::scheduler::{Caller, Now, Scheduler, Settings, on_connect, on_heartbeat, on_tick};
use crate::store;
use proto::v1;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

/// A worker's introduction, and what a coordinator that has run for a while makes of it.
pub fn hello(bytes: &[u8]) {
    let Ok(hello) = <v1::Hello as prost::Message>::decode(bytes) else { return };
    if let Ok(greeting) = api::check_hello(hello, String::new(), Arc::default()) {
        let settings = Settings::new(1, DEFAULT_LEASE);
        let mut scheduler = Scheduler::new(settings, PermitKey::new([0; 32]), 1, BTreeSet::new());
        let at = |seconds| Now { since_start: Duration::from_secs(seconds), unix_ms: 0 };
        let worker = greeting.worker.clone();
        let welcome = on_connect(&mut scheduler, at(3600), greeting);
        on_heartbeat(&mut scheduler, at(3601), &worker, welcome.session, &welcome.keep, &[]);
        on_tick(&mut scheduler, at(7200));
    }
}

/// A worker's result.
pub fn complete(bytes: &[u8]) {
    if let Ok(request) = <v1::CompleteRequest as prost::Message>::decode(bytes) {
        let _ = api::check_completed(request, Caller::default());
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

//! Fuzzing entry points: parsers of bytes from unauthenticated peers, workers and stores. Each must return a value or
//! an error for any bytes.

use crate::api;
use crate::limits::DEFAULT_LEASE;
use crate::permit::PermitKey;
use crate::scheduler::{Caller, Now, Scheduler, Settings, on_connect, on_heartbeat, on_tick};
use crate::store;
use proto::v1;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

/// Parses a worker's Hello and passes it to a scheduler that has run for a while.
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

/// Parses a worker's result.
pub fn complete(bytes: &[u8]) {
    if let Ok(request) = <v1::CompleteRequest as prost::Message>::decode(bytes) {
        let _ = api::check_completed(request, Caller::default());
    }
}

/// Parses bytes as each kind of blob in a store.
pub fn blob(bytes: &[u8]) {
    store::decode_anything(bytes);
}

/// Parses a token file.
pub fn tokens(text: &str) {
    if let Ok(access) = crate::Access::parse(text) {
        assert!(access.count() > 0);
    }
}

/// Parses a `--store` URL.
pub fn store_url(text: &str) {
    if let Ok(url) = text.parse::<crate::StoreUrl>() {
        // The URL without its password.
        let _ = url.to_string();
    }
}

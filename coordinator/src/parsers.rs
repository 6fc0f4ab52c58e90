//! What reads the bytes of strangers and of stores, for fuzzing: each must answer any bytes with a value or an error.

use crate::api;
use crate::store;
use proto::v1;

/// A worker's introduction.
pub fn hello(bytes: &[u8]) {
    if let Ok(hello) = <v1::Hello as prost::Message>::decode(bytes) {
        let _ = api::check_hello(hello, String::new());
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

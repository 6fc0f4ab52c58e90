//! A connection is an open file, and most systems start a program with room for 1024 of them.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Asks the system for as many open files as it would give: each worker takes two. Without luck it stays as it was, and
/// workers beyond the limit can't connect.
pub fn raise() {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    if current == maximum {
        return;
    }
    match setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum }) {
        Ok(()) => tracing::debug!(before = current, now = maximum, "open files"),
        Err(error) => tracing::warn!(limit = current, %error, "the limit of open files can't be raised"),
    }
}

//! Limit on open files. Each connection is an open file, and most systems allow a process 1024 by default.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Raises the limit on open files to the maximum that the system allows: each worker takes two. If that fails, the
/// limit stays unchanged, and workers beyond it can't connect.
pub fn raise() {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    if current == maximum {
        return;
    }
    match setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum }) {
        Ok(()) => tracing::debug!(before = current, now = maximum, "limit on open files raised"),
        Err(error) => tracing::warn!(limit = current, %error, "can't raise the limit on open files"),
    }
}

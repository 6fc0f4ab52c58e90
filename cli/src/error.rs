//! What can go wrong, in one sentence each: which file, which field, which value, what to do.

use sim_core::base::digest::Digest;
use sim_core::base::error::Invalid;
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Why a command did not do what was asked.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The command line asks for something that can't be. Exit code 2.
    #[error("{message}")]
    Usage {
        /// The sentence.
        message: String,
    },
    /// Ctrl-C or a request to terminate. Exit code 130.
    #[error("interrupted{hint}")]
    Interrupted {
        /// How to go on, led by a separator; or empty.
        hint: String,
    },
    /// The reader of our output has gone (`| head`): nobody is left to tell.
    #[error("the output was closed")]
    OutputClosed,
    /// A file or folder can't be read.
    #[error("can't read {path}: {reason}", path = .path.display(), reason = plain(.source))]
    Read {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file or folder can't be written; nothing is left of the attempt.
    #[error("can't write {path}: {reason}", path = .path.display(), reason = plain(.source))]
    Write {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file holds what can't be used.
    #[error("{file}: {source}")]
    Invalid {
        /// The file, or what ships under a name.
        file: String,
        /// What is wrong in it.
        source: Invalid,
    },
    /// A stored file of ours was changed or is damaged.
    #[error("{path} is damaged: {reason}", path = .path.display())]
    Damaged {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A folder whose run has not come to its end.
    #[error("{folder} has no result yet: the same `evogait run` goes on and finishes it", folder = .folder.display())]
    NotFinished {
        /// The output folder.
        folder: PathBuf,
    },
    /// A name that is neither a path nor ships.
    #[error("there is no file and no {what} named \"{name}\": {what}s that ship are {known}")]
    NotFound {
        /// "job", "robot".
        what: &'static str,
        /// What was asked for.
        name: String,
        /// The names that exist.
        known: String,
    },
    /// Output would replace a file that the command reads.
    #[error(
        "{path} is a file that this command reads{alias}, and writing there would replace it: choose another place with --out",
        path = .path.display(), alias = alias(.path, .input)
    )]
    ReplacesInput {
        /// The output.
        path: PathBuf,
        /// The same file under the name by which it was read.
        input: PathBuf,
    },
    /// The folder's job file was not written by a run.
    #[error(
        "{path} is not a job file that evogait wrote, and a run keeps its own there: choose another folder with --out",
        path = .path.display()
    )]
    ForeignJob {
        /// The job file in the folder.
        path: PathBuf,
    },
    /// The folder belongs to another job.
    #[error(
        "{folder} holds another job, \"{name}\" ({digest}): choose another folder with --out",
        folder = .folder.display(), digest = .digest.short()
    )]
    OtherJob {
        /// The folder.
        folder: PathBuf,
        /// Name of the job in it.
        name: String,
        /// Its digest.
        digest: Digest,
    },
    /// The folder has files that no run of the job left there.
    #[error("{folder} is not empty and holds no run of this job: choose another folder with --out", folder = .folder.display())]
    NotOurs {
        /// The folder.
        folder: PathBuf,
    },
    /// Another process is at work in the folder.
    #[error("another evogait is at work in {folder}: wait for it, or stop it", folder = .folder.display())]
    Busy {
        /// The folder.
        folder: PathBuf,
    },
    /// Nobody answers at the coordinator's address.
    #[error(
        "can't reach a coordinator at {url}: {reason}; start one with `coordinator`, or tell where it is with --coordinator URL"
    )]
    Unreachable {
        /// Its address.
        url: String,
        /// Why.
        reason: String,
    },
    /// The coordinator answers and leaves the work to another one.
    #[error("the coordinator at {url} does not serve now: another one does, or it is starting or stopping")]
    StandsBy {
        /// Its address.
        url: String,
    },
    /// A process of this machine that should be well.
    #[error("what runs at {address} is not well: {reason}")]
    Unwell {
        /// Where it serves its metrics.
        address: SocketAddr,
        /// What it says, or why it says nothing.
        reason: String,
    },
    /// The coordinator refuses.
    #[error("the coordinator at {url} refuses: {reason}")]
    Refused {
        /// Its address.
        url: String,
        /// Its sentence.
        reason: String,
    },
    /// The coordinator has no such job.
    #[error("the coordinator at {url} has no job \"{id}\": `evogait list` shows what it has")]
    NoSuchJob {
        /// Its address.
        url: String,
        /// What was asked for.
        id: String,
    },
    /// The coordinator's answer makes no sense to this version.
    #[error("the coordinator at {url} answers with something this version can't read: {reason}")]
    Answer {
        /// Its address.
        url: String,
        /// What.
        reason: String,
    },
    /// The coordinator of a run on this machine does not work.
    #[error("the coordinator of this run failed: {reason}")]
    LocalCoordinator {
        /// Why.
        reason: String,
    },
    /// The worker of a run on this machine does not work.
    #[error("the worker of this run failed: {reason}")]
    LocalWorker {
        /// Why.
        reason: String,
    },
    /// The job ended without a result.
    #[error("job \"{name}\" ({id}) {how}")]
    JobEnded {
        /// Its name.
        name: String,
        /// Its id.
        id: String,
        /// How and why.
        how: String,
    },
    /// The job's robot can't stand, or its start is blocked.
    #[error("job \"{name}\" ({id}) failed: {reason}")]
    Unprepared {
        /// Its name.
        name: String,
        /// Its id.
        id: String,
        /// The fault, for people.
        reason: String,
    },
    /// A job that has no winner, where one is needed.
    #[error("{folder} has no winner: every evaluation of the job failed", folder = .folder.display())]
    NoWinner {
        /// The output folder.
        folder: PathBuf,
    },
    /// An engine did not report all that went wrong.
    #[error("{rollouts} rollouts left a bound that the engine did not report")]
    Unsound {
        /// How many.
        rollouts: u64,
    },
    /// A recomputed number has other bits than the stored one.
    #[error("{folder} does not verify: {difference}", folder = .folder.display())]
    Different {
        /// The output folder.
        folder: PathBuf,
        /// What differs, and why that may be.
        difference: String,
    },
    /// A picture can't be made.
    #[error("can't draw {what}: {reason}")]
    Draw {
        /// Which picture.
        what: String,
        /// Why.
        reason: String,
    },
}

impl Error {
    /// A read that failed.
    pub fn read(path: &Path, source: io::Error) -> Self {
        Self::Read { path: path.to_owned(), source }
    }

    /// A write that failed.
    pub fn write(path: &Path, source: io::Error) -> Self {
        Self::Write { path: path.to_owned(), source }
    }

    /// What the process ends with.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::OutputClosed => ExitCode::SUCCESS,
            Self::Usage { .. } => ExitCode::from(2),
            Self::Interrupted { .. } => ExitCode::from(130),
            _ => ExitCode::FAILURE,
        }
    }
}

/// The input's own name, where it was read under another.
fn alias(path: &Path, input: &Path) -> String {
    if path == input { String::new() } else { format!(" as {}", input.display()) }
}

/// An I/O error in words, without the system's "(os error 2)".
fn plain(error: &io::Error) -> String {
    let text = error.to_string();
    match text.find(" (os error") {
        Some(end) => text[..end].to_owned(),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_system_s_numbers_are_left_out() {
        assert_eq!(plain(&io::Error::from_raw_os_error(2)), "No such file or directory");
        assert_eq!(plain(&io::Error::other("the reason")), "the reason");
    }
}

//! Errors of the commands. Each text is one sentence with the file, the field, the value and the remedy.

use sim_core::base::digest::Digest;
use sim_core::base::error::Invalid;
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Reason why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Invalid command line. Exit code 2.
    #[error("{message}")]
    Usage {
        /// Text of the error.
        message: String,
    },
    /// Ctrl-C, a closed terminal or a request to terminate. Exit code 130.
    #[error("interrupted{hint}")]
    Interrupted {
        /// Instruction for going on, with a leading separator; may be empty.
        hint: String,
    },
    /// Standard output was closed by its reader (`| head`). Exit code 0, no message.
    #[error("the output was closed")]
    OutputClosed,
    /// File or folder that can't be read.
    #[error("can't read {path}: {reason}", path = .path.display(), reason = plain(.source))]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// Cause of the failure.
        source: io::Error,
    },
    /// File or folder that can't be written; no partial file remains.
    #[error("can't write {path}: {reason}", path = .path.display(), reason = plain(.source))]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// Cause of the failure.
        source: io::Error,
    },
    /// Input with an invalid value.
    #[error("{file}: {source}")]
    Invalid {
        /// Path of the file, or name of the shipped scenario.
        file: String,
        /// The invalid value.
        source: Invalid,
    },
    /// File of an output folder that was changed or damaged.
    #[error("{path} is damaged: {reason}", path = .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Description of the damage.
        reason: String,
    },
    /// Output folder of an unfinished run.
    #[error("{folder} has no result yet: repeat its `evogait run` to finish it", folder = .folder.display())]
    NotFinished {
        /// The output folder.
        folder: PathBuf,
    },
    /// Name that is neither a file nor a shipped scenario.
    #[error("there is no file and no {what} named \"{name}\": {what}s that ship are {known}")]
    NotFound {
        /// Kind of scenario, such as "job" or "robot".
        what: &'static str,
        /// The unknown name.
        name: String,
        /// The shipped names.
        known: String,
    },
    /// Output that would replace a file that the command reads.
    #[error(
        "{path} is a file that this command reads{alias}, and writing there would replace it: choose another place with --out",
        path = .path.display(), alias = alias(.path, .input)
    )]
    ReplacesInput {
        /// Path of the output.
        path: PathBuf,
        /// Path under which the same file was read.
        input: PathBuf,
    },
    /// Output folder with a job file that no run wrote.
    #[error(
        "{path} is not a job file that evogait wrote, and the run would write its own there: choose another folder with --out",
        path = .path.display()
    )]
    ForeignJob {
        /// Path of the job file in the folder.
        path: PathBuf,
    },
    /// Output folder of another job.
    #[error(
        "{folder} holds another job, \"{name}\" ({digest}): choose another folder with --out",
        folder = .folder.display(), digest = .digest.short()
    )]
    OtherJob {
        /// The output folder.
        folder: PathBuf,
        /// Name of the job in it.
        name: String,
        /// Digest of the job in it.
        digest: Digest,
    },
    /// Output folder with files that no run of the job wrote.
    #[error(
        "{folder} is not empty and holds no run of this job: choose another folder with --out",
        folder = .folder.display()
    )]
    NotOurs {
        /// The output folder.
        folder: PathBuf,
    },
    /// Output folder that another process uses.
    #[error("another evogait process uses {folder}: wait until it ends, or stop it", folder = .folder.display())]
    Busy {
        /// The output folder.
        folder: PathBuf,
    },
    /// Coordinator's address that does not answer.
    #[error(
        "can't reach a coordinator at {url}: {reason}; start one with `coordinator`, or give its address with --coordinator URL"
    )]
    Unreachable {
        /// Address of the coordinator.
        url: String,
        /// Cause of the failure.
        reason: String,
    },
    /// Coordinator that answers, but is on standby.
    #[error("the coordinator at {url} is not serving: another one serves, or this one is starting or stopping")]
    StandsBy {
        /// Address of the coordinator.
        url: String,
    },
    /// Unhealthy process of this machine.
    #[error("the process at {address} is not healthy: {reason}")]
    Unwell {
        /// Address of its metrics.
        address: SocketAddr,
        /// State that it reports, or the reason why it does not answer.
        reason: String,
    },
    /// Request that the coordinator refused.
    #[error("the coordinator at {url} refused the request: {reason}")]
    Refused {
        /// Address of the coordinator.
        url: String,
        /// Reason given by the coordinator.
        reason: String,
    },
    /// Job that the coordinator does not have.
    #[error("the coordinator at {url} has no job \"{id}\": `evogait list` lists its jobs")]
    NoSuchJob {
        /// Address of the coordinator.
        url: String,
        /// The unknown id.
        id: String,
    },
    /// Answer of a coordinator that this version can't read.
    #[error("this version can't read the answer of the coordinator at {url}: {reason}")]
    Answer {
        /// Address of the coordinator.
        url: String,
        /// The unreadable part of the answer.
        reason: String,
    },
    /// Failed coordinator of a run on this machine.
    #[error("the coordinator of this run failed: {reason}")]
    LocalCoordinator {
        /// Cause of the failure.
        reason: String,
    },
    /// Failed worker of a run on this machine.
    #[error("the worker of this run failed: {reason}")]
    LocalWorker {
        /// Cause of the failure.
        reason: String,
    },
    /// Job that ended without a result.
    #[error("job \"{name}\" ({id}) {how}")]
    JobEnded {
        /// Name of the job.
        name: String,
        /// Id of the job.
        id: String,
        /// State in which it ended, and the reason.
        how: String,
    },
    /// Job that failed because its robot can't stand, or its start is blocked.
    #[error("job \"{name}\" ({id}) failed: {reason}")]
    Unprepared {
        /// Name of the job.
        name: String,
        /// Id of the job.
        id: String,
        /// Reason for people.
        reason: String,
    },
    /// Result without a winner, where the command needs one.
    #[error("{folder} has no winner: every evaluation of the job failed", folder = .folder.display())]
    NoWinner {
        /// The output folder.
        folder: PathBuf,
    },
    /// Rollouts that exceeded a bound without a report of the engine.
    #[error("{rollouts} rollouts exceeded a bound that the engine did not report: use a setting with smaller steps")]
    Unsound {
        /// Number of these rollouts.
        rollouts: u64,
    },
    /// Recomputed number with other bits than the stored one.
    #[error("{folder} does not verify: {difference}", folder = .folder.display())]
    Different {
        /// The output folder.
        folder: PathBuf,
        /// The two values, and possible reasons.
        difference: String,
    },
    /// Task of a stored result that can't be carried out again.
    #[error("can't compute the result again: {reason}; verify it with the version of evogait that made it")]
    NotRepeated {
        /// Cause of the failure.
        reason: String,
    },
    /// Motion sequence that can't be read, or is not feasible.
    #[error("{}: {reason}", .file.display())]
    Sequence {
        /// Path of the file.
        file: PathBuf,
        /// Place and cause.
        reason: String,
    },
    /// Picture that can't be drawn.
    #[error("can't draw {what}: {reason}")]
    Draw {
        /// Name of the picture.
        what: String,
        /// Cause of the failure.
        reason: String,
    },
}

impl Error {
    /// Returns the error of a failed read.
    pub fn read(path: &Path, source: io::Error) -> Self {
        Self::Read { path: path.to_owned(), source }
    }

    /// Returns the error of a failed write.
    pub fn write(path: &Path, source: io::Error) -> Self {
        Self::Write { path: path.to_owned(), source }
    }

    /// Returns the exit code of the process.
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::OutputClosed => ExitCode::SUCCESS,
            Self::Usage { .. } => ExitCode::from(2),
            Self::Interrupted { .. } => ExitCode::from(130),
            _ => ExitCode::FAILURE,
        }
    }
}

/// Formats the path under which the input was read; empty if it is the output's path.
fn alias(path: &Path, input: &Path) -> String {
    if path == input { String::new() } else { format!(" as {}", input.display()) }
}

/// Formats an I/O error without the system's number, "(os error 2)".
pub fn plain(error: &io::Error) -> String {
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
    fn io_error_text_omits_system_number() {
        assert_eq!(plain(&io::Error::from_raw_os_error(2)), "No such file or directory");
        assert_eq!(plain(&io::Error::other("the reason")), "the reason");
    }
}

//! Permits: proof that an assignment was issued, without a stored record of it. A result is accepted only with its
//! permit, also late results and results after a restart.

use crate::record::{AssignmentId, JobId, Range, WorkerId};
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;
use sim_core::base::digest::Digest;

/// Length of a permit, bytes: the digest of the assignment's tasks, then the authentication code.
const LENGTH: usize = 64;

/// Secret key for permits: random, one per store, never shown or sent.
#[derive(Clone)]
pub struct PermitKey([u8; 32]);

impl std::fmt::Debug for PermitKey {
    /// Writes the type's name only, not the key.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("PermitKey")
    }
}

/// Assignment, as issued to a worker.
#[derive(Clone, Copy, Debug)]
pub struct Issued<'a> {
    /// Id of the assignment.
    pub assignment: AssignmentId,
    /// Worker that received the assignment.
    pub worker: &'a WorkerId,
    /// Job of the tasks.
    pub job: &'a JobId,
    /// Range of the tasks.
    pub range: Range,
}

impl PermitKey {
    /// Creates the key from the bytes in a store.
    pub fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// Returns true if both keys make the same permits.
    #[cfg(test)]
    pub(crate) fn is_the_same_as(&self, other: &Self) -> bool {
        self.0 == other.0
    }

    /// Returns the permit of an assignment with these tasks.
    pub fn issue(&self, issued: Issued<'_>, tasks: &[Vec<u8>]) -> Vec<u8> {
        let tasks = digest(tasks);
        let code = self.code(issued, &tasks).finalize().into_bytes();
        [tasks.0.as_slice(), code.as_slice()].concat()
    }

    /// Returns true if a permit belongs to an assignment. Its tasks are not checked, see [`is_of`].
    pub fn admits(&self, issued: Issued<'_>, permit: &[u8]) -> bool {
        let Some((tasks, code)) = permit.split_first_chunk::<32>().filter(|_| permit.len() == LENGTH) else {
            return false;
        };
        self.code(issued, &Digest(*tasks)).verify_slice(code).is_ok()
    }

    fn code(&self, issued: Issued<'_>, tasks: &Digest) -> Hmac<Sha256> {
        let mut code = Hmac::<Sha256>::new_from_slice(&self.0).expect("HMAC accepts keys of any length");
        let Range { round, first, count } = issued.range;
        code.update(b"evogait permit 1");
        code.update(&issued.assignment.0.to_le_bytes());
        for number in [round, first, count] {
            code.update(&number.to_le_bytes());
        }
        code.update(&tasks.0);
        for text in [issued.job.as_str(), &issued.worker.0] {
            code.update(&(text.len() as u64).to_le_bytes());
            code.update(text.as_bytes());
        }
        code
    }
}

/// Returns true if a permit was issued for these tasks. The permit must have been checked before.
pub fn is_of(permit: &[u8], tasks: &[Vec<u8>]) -> bool {
    permit.get(..32) == Some(digest(tasks).0.as_slice())
}

fn digest(tasks: &[Vec<u8>]) -> Digest {
    Digest::of("evogait tasks 1", &tasks)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn permit_is_valid_for_its_assignment_only() {
        let key = PermitKey::new([7; 32]);
        let (worker, job) = (WorkerId("w".into()), JobId::from("j1"));
        let range = Range { round: 3, first: 4, count: 2 };
        let issued = Issued { assignment: AssignmentId(9), worker: &worker, job: &job, range };
        let tasks = vec![vec![1, 2], vec![3]];
        let permit = key.issue(issued, &tasks);
        assert!(key.admits(issued, &permit) && is_of(&permit, &tasks));
        assert!(!is_of(&permit, &[vec![1], vec![2, 3]]));
        let (other_worker, other_job) = (WorkerId("v".into()), JobId::from("j2"));
        for other in [
            Issued { assignment: AssignmentId(8), ..issued },
            Issued { worker: &other_worker, ..issued },
            Issued { job: &other_job, ..issued },
            Issued { range: Range { round: 2, ..range }, ..issued },
            Issued { range: Range { first: 3, ..range }, ..issued },
            Issued { range: Range { count: 1, ..range }, ..issued },
        ] {
            assert!(!key.admits(other, &permit), "{other:?}");
        }
        assert!(!PermitKey::new([8; 32]).admits(issued, &permit));
        for broken in [&permit[..63], &[], &[permit.as_slice(), &[0]].concat()] {
            assert!(!key.admits(issued, broken));
        }
        for bit in 0..LENGTH * 8 {
            let mut turned = permit.clone();
            turned[bit / 8] ^= 1 << (bit % 8);
            assert!(!key.admits(issued, &turned), "bit {bit}");
        }
    }
}

//! Permits: proof that an assignment was issued, which needs no record of it. A result is accepted only with one, late and
//! after restarts too.

use crate::record::{AssignmentId, JobId, Range, WorkerId};
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;
use sim_core::base::digest::Digest;

/// Length of a permit: the digest of the assignment's tasks, then the code over everything.
const LENGTH: usize = 64;

/// The secret that permits are made with: random, one a store, never told.
#[derive(Clone)]
pub struct PermitKey([u8; 32]);

impl std::fmt::Debug for PermitKey {
    /// Tells nothing of it.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("PermitKey")
    }
}

/// An assignment as it was issued.
#[derive(Clone, Copy, Debug)]
pub struct Issued<'a> {
    /// Its id.
    pub assignment: AssignmentId,
    /// The worker that it was issued to.
    pub worker: &'a WorkerId,
    /// The job.
    pub job: &'a JobId,
    /// The tasks.
    pub range: Range,
}

impl PermitKey {
    /// The key that a store keeps.
    pub fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// Whether two stores would make the same permits.
    #[cfg(test)]
    pub(crate) fn is_the_same_as(&self, other: &Self) -> bool {
        self.0 == other.0
    }

    /// The permit of an assignment with these tasks.
    pub fn issue(&self, issued: Issued<'_>, tasks: &[Vec<u8>]) -> Vec<u8> {
        let tasks = digest(tasks);
        let code = self.code(issued, &tasks).finalize().into_bytes();
        [tasks.0.as_slice(), code.as_slice()].concat()
    }

    /// Whether a permit is that of an assignment, whatever its tasks.
    pub fn admits(&self, issued: Issued<'_>, permit: &[u8]) -> bool {
        let Some((tasks, code)) = permit.split_first_chunk::<32>().filter(|_| permit.len() == LENGTH) else {
            return false;
        };
        self.code(issued, &Digest(*tasks)).verify_slice(code).is_ok()
    }

    fn code(&self, issued: Issued<'_>, tasks: &Digest) -> Hmac<Sha256> {
        let mut code = Hmac::<Sha256>::new_from_slice(&self.0).expect("a key of any length will do");
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

/// Whether tasks are those that a permit was issued for. The permit itself was checked before.
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
    fn permit_is_good_for_its_assignment_alone() {
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

//! Workers that give signs of life and compute nothing: their work goes to others.

use super::lease::AssignmentId;
use super::notes::LeaseEnd;
use super::worker::WorkerId;
use super::{Now, Scheduler};
use std::time::Duration;

/// A worker whose work had to be taken back so often, without a result in between, gets no more until it connects again.
pub(super) const MOST_TIMES: u32 = 3;

impl Scheduler {
    /// Takes in how far a worker is, where it counts, and takes back what stands still.
    pub(super) fn watch_progress(&mut self, now: Now, id: &WorkerId, progress: &[(AssignmentId, u64)]) {
        for &(assignment, count) in progress {
            if let Some(lease) = self.leases.get_mut(&assignment).filter(|l| l.worker == *id) {
                if lease.progress.is_some_and(|before| count > before) || lease.progress.is_none() && count > 0 {
                    lease.moved = now.since_start;
                }
                lease.progress = Some(count);
            }
        }
        for assignment in self.stuck(now, id) {
            self.take_back(now, id, assignment);
        }
    }

    /// What stands still. Work that has not begun waits, as long as every slot is busy with something that moves.
    fn stuck(&self, now: Now, id: &WorkerId) -> Vec<AssignmentId> {
        let Some(worker) = self.workers.get(id) else { return Vec::new() };
        let still = |since: Duration| now.since_start.saturating_sub(since) >= worker.stuck_after;
        let counted = || {
            worker
                .held
                .iter()
                .filter_map(|a| Some((*a, self.leases.get(a)?)))
                .filter_map(|(a, l)| Some((a, l.progress?, l.moved)))
        };
        let moving = counted().filter(|(_, count, moved)| *count > 0 && !still(*moved)).count();
        let all_busy = moving >= worker.slots as usize;
        counted().filter(|(_, count, moved)| still(*moved) && !(*count == 0 && all_busy)).map(|(a, ..)| a).collect()
    }

    /// Gives work to others. To blame it must have begun: what waited for a slot that never came has done nothing.
    fn take_back(&mut self, now: Now, id: &WorkerId, assignment: AssignmentId) {
        let Some(lease) = self.leases.get(&assignment).cloned() else { return };
        self.take_away(&[assignment], LeaseEnd::Stuck);
        let (mut name, mut seconds) = (String::new(), 0.0);
        if let Some(worker) = self.workers.get_mut(id) {
            seconds = worker.stuck_after.as_secs_f64();
            worker.stuck += 1;
            self.room.workers_changed();
            // Others first.
            worker.refused.insert(lease.job.clone(), now.since_start + self.settings.lease);
            name.clone_from(&worker.name);
        }
        self.wake_by(now.since_start + self.settings.lease);
        if lease.progress.is_some_and(|count| count > 0) {
            self.blame(now, &lease, true, None, &format!("worker {name} made no progress with it for {seconds} s"));
        }
    }
}

//! Workers that have to go: machines that go away at a time that is known get what fits before it, and are told to stop in
//! time; who may not stay goes at once.

use super::fair::UNKNOWN_COST;
use super::notes::LeaseEnd;
use super::worker::{SessionId, Worker, WorkerId};
use super::{Action, Message, Now, Scheduler};
use std::time::Duration;

impl Scheduler {
    /// How many tasks of this cost, s, a worker can do before its machine goes away.
    pub(super) fn time_for(&self, now: Now, worker: &Worker, cost: Option<f64>) -> u32 {
        let Some(stops) = self.stops(worker) else { return u32::MAX };
        let left = stops.saturating_sub(now.since_start).as_secs_f64();
        (left / cost.unwrap_or(UNKNOWN_COST).max(1e-6)).floor().min(f64::from(u32::MAX)) as u32
    }

    /// When a worker is told to stop: early enough to deliver what it has.
    pub(super) fn stops(&self, worker: &Worker) -> Option<Duration> {
        worker.ends.map(|ends| ends.saturating_sub(self.settings.farewell()))
    }

    /// A worker may not go on in this session: what it has goes to others at once, and nothing is to blame.
    pub fn expel(&mut self, now: Now, id: &WorkerId, session: SessionId) {
        let Some(worker) = self.session(id, session) else { return };
        for assignment in worker.held.clone() {
            self.release(assignment, LeaseEnd::Drained);
        }
        self.workers.remove(id);
        self.room.workers_changed();
        self.dispatch(now);
    }

    /// Drains the workers whose machines are about to go away. What they compute may still be delivered.
    pub(super) fn drain_leaving(&mut self, now: Now) {
        let leaving = |w: &Worker| !w.draining && self.stops(w).is_some_and(|at| at <= now.since_start);
        let leaving: Vec<WorkerId> =
            self.workers.iter().filter(|(_, w)| leaving(w)).map(|(id, _)| id.clone()).collect();
        for id in leaving {
            let Some(worker) = self.workers.get_mut(&id) else { continue };
            worker.draining = true;
            self.room.workers_changed();
            if let Some(session) = worker.session {
                let reason = "the machine is about to go away, as the worker said".to_owned();
                self.actions.push(Action::Send(id.clone(), session, Message::Drain(reason)));
            }
            for assignment in self.workers.get(&id).map(|w| w.held.clone()).unwrap_or_default() {
                self.release(assignment, LeaseEnd::Drained);
            }
        }
    }
}

//! Workers that have to go: machines that go away at a known time get what fits before it, and are told to stop in time.

use super::dispatch::UNKNOWN_COST;
use super::fleet::{Worker, WorkerId};
use super::lease::end_lease;
use super::notes::LeaseEnd;
use super::{Action, Message, Now, Scheduler, Settings};
use std::time::Duration;

/// How many tasks of this cost, s, a worker can do before its machine goes away.
pub(super) fn time_for(settings: &Settings, now: Now, worker: &Worker, cost: Option<f64>) -> u32 {
    let Some(stops) = stops(settings, worker) else { return u32::MAX };
    let left = stops.saturating_sub(now.since_start).as_secs_f64();
    (left / cost.unwrap_or(UNKNOWN_COST).max(1e-6)).floor().min(f64::from(u32::MAX)) as u32
}

/// When a worker is told to stop: early enough to deliver what it has.
pub(super) fn stops(settings: &Settings, worker: &Worker) -> Option<Duration> {
    worker.ends.map(|ends| ends.saturating_sub(settings.farewell()))
}

/// Drains the workers whose machines are about to go away. What they compute may still be delivered.
pub(super) fn drain_leaving(core: &mut Scheduler, now: Now) {
    let settings = core.settings;
    let leaving = |w: &Worker| !w.draining && stops(&settings, w).is_some_and(|at| at <= now.since_start);
    let leaving: Vec<WorkerId> =
        core.fleet.workers.iter().filter(|(_, w)| leaving(w)).map(|(id, _)| id.clone()).collect();
    for id in leaving {
        let Some(worker) = core.fleet.workers.get_mut(&id) else { continue };
        worker.draining = true;
        core.queue.room.workers_changed();
        if let Some(session) = worker.session {
            let reason = "the machine is about to go away, as the worker said".to_owned();
            core.out.actions.push(Action::Send(id.clone(), session, Message::Drain(reason)));
        }
        for assignment in core.fleet.workers.get(&id).map(|w| w.held.clone()).unwrap_or_default() {
            end_lease(core, assignment, LeaseEnd::Drained);
        }
    }
}

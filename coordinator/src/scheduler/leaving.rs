//! Workers on machines that shut down at a known time. They get only tasks that fit into the remaining time, and are
//! drained early enough to deliver their results.

use super::dispatch::UNKNOWN_COST;
use super::fleet::{Worker, WorkerId};
use super::lease::end_lease;
use super::notes::LeaseEnd;
use super::{Action, Message, Now, Scheduler, Settings};
use std::time::Duration;

/// Returns the number of tasks of this cost, s, that a worker can run before it is drained.
pub(super) fn time_for(settings: &Settings, now: Now, worker: &Worker, cost: Option<f64>) -> u32 {
    let Some(stops) = stops(settings, worker) else { return u32::MAX };
    let left = stops.saturating_sub(now.since_start).as_secs_f64();
    (left / cost.unwrap_or(UNKNOWN_COST).max(1e-6)).floor().min(f64::from(u32::MAX)) as u32
}

/// Returns the time at which a leaving worker must be drained.
pub(super) fn stops(settings: &Settings, worker: &Worker) -> Option<Duration> {
    worker.ends.map(|ends| ends.saturating_sub(settings.drain_lead_time()))
}

/// Drains the workers on machines that shut down soon. Their leases end, but results that they still deliver count.
pub(super) fn revoke_leaving(core: &mut Scheduler, now: Now) {
    let settings = core.settings;
    let leaving = |w: &Worker| !w.draining && stops(&settings, w).is_some_and(|at| at <= now.since_start);
    let leaving: Vec<WorkerId> =
        core.fleet.workers.iter().filter(|(_, w)| leaving(w)).map(|(id, _)| id.clone()).collect();
    for id in leaving {
        let Some(worker) = core.fleet.workers.get_mut(&id) else { continue };
        worker.draining = true;
        core.queue.room.workers_changed();
        if let Some(session) = worker.session {
            let reason = "the machine will shut down soon (time given by its worker)".to_owned();
            core.out.actions.push(Action::Send(id.clone(), session, Message::Drain(reason)));
        }
        for assignment in core.fleet.workers.get(&id).map(|w| w.held.clone()).unwrap_or_default() {
            end_lease(core, assignment, LeaseEnd::Drained);
        }
    }
}

//! Tests of the cost of an event: it depends on the changes, not on the number of workers.

use super::*;

/// Dispatch steps per result with this number of workers, while all are busy and tasks are pending.
fn steps_per_result(workers: u32) -> f64 {
    let mut rig = Rig::new();
    for worker in 0..workers {
        rig.connect(&format!("w{worker}"), 1);
    }
    rig.submit("long", 20 * workers, 20);
    let one_result_per_worker = |rig: &mut Rig| {
        for _ in 0..workers {
            let given = rig.take().expect("tasks are pending");
            let mut completed = given.completed(given.delivery());
            completed.compute = Duration::from_millis(50) * given.range().count;
            rig.complete(completed);
        }
        rig.scheduler.queue.room.steps
    };
    // Every worker has delivered once: tasks are known to be short, so some are leased in advance.
    let before = one_result_per_worker(&mut rig);
    (one_result_per_worker(&mut rig) - before) as f64 / f64::from(workers)
}

#[test]
fn cost_of_result_is_constant_in_workers() {
    let (few, many) = (steps_per_result(10), steps_per_result(1000));
    assert!(many <= few + 2.0, "{few} steps with 10 workers, {many} with 1000");
}

/// Dispatch steps per heartbeat of an idle worker, while this number of other workers is busy.
fn steps_per_heartbeat(busy: u32) -> f64 {
    let mut rig = Rig::new();
    let workers: Vec<String> = (0..2 * busy).map(|worker| format!("w{worker}")).collect();
    let sessions: Vec<SessionId> = workers.iter().map(|id| rig.connect(id, 1)).collect();
    rig.submit("wide", busy, 2);
    let given = rig.take().expect("an assignment");
    rig.answer(&given);
    rig.now.since_start += Duration::from_millis(900);
    let before = rig.scheduler.queue.room.steps;
    let idle = workers.iter().zip(sessions).filter(|(id, _)| rig.given.iter().all(|g| *g.worker.0 != **id));
    for (id, session) in idle.collect::<Vec<_>>() {
        rig.heartbeat(id, session, 0);
    }
    (rig.scheduler.queue.room.steps - before) as f64 / f64::from(busy)
}

#[test]
fn cost_of_heartbeat_is_constant_in_leases() {
    let (few, many) = (steps_per_heartbeat(10), steps_per_heartbeat(500));
    assert!(many <= few + 2.0, "{few} steps with 10 leases, {many} with 500");
}

/// Dispatch steps per result with this number of workers, while a suspect waits for an idle worker.
fn steps_with_pending_suspect(workers: u32) -> f64 {
    let mut rig = Rig::new();
    let sessions: Vec<SessionId> = (0..workers).map(|worker| rig.connect(&format!("w{worker}"), 1)).collect();
    rig.submit("long", 40 * workers, 20);
    let result = |rig: &mut Rig, at: usize| {
        let given = rig.given.remove(at);
        let mut completed = given.completed(given.delivery());
        completed.compute = Duration::from_millis(50) * given.range().count;
        rig.complete(completed);
    };
    // Every worker has a lease in advance from now on.
    (0..workers).for_each(|_| result(&mut rig, 0));
    let lost = WorkerId("w0".into());
    on_disconnect(&mut rig.scheduler, rig.now, &lost, sessions[0]);
    rig.given.retain(|g| g.worker != lost);
    rig.advance(LEASE / 5);
    let cell = rig.scheduler.queue.reserved.values().next().expect("a worker is reserved").clone();
    let before = rig.scheduler.queue.room.steps;
    for _ in 1..workers {
        let other = rig.given.iter().position(|g| g.worker != cell).expect("an assignment of another worker");
        result(&mut rig, other);
    }
    assert!(rig.scheduler.queue.reserved.values().eq([&cell]), "the worker is still reserved");
    (rig.scheduler.queue.room.steps - before) as f64 / f64::from(workers - 1)
}

#[test]
fn waiting_suspect_costs_no_scan_of_workers() {
    let (few, many) = (steps_with_pending_suspect(10), steps_with_pending_suspect(500));
    assert!(many <= few + 2.0, "{few} steps with 10 workers, {many} with 500");
}

#[test]
fn leases_lost_together_are_written_once() {
    let mut rig = Rig::new();
    rig.submit("a", 200, 1);
    for worker in 0..100 {
        let session = rig.connect(&format!("w{worker}"), 2);
        rig.disconnect(&format!("w{worker}"), session);
    }
    rig.commit_and_collect();
    rig.now.since_start += LEASE;
    on_tick(&mut rig.scheduler, rig.now);
    let written = rig.scheduler.take_actions().iter().filter(|a| matches!(a, Action::Write(_))).count();
    assert_eq!(written, 1);
}

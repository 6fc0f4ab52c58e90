//! Laws about the cost of an event: it grows with the changes, not with the fleet.

use super::*;

/// Steps of dispatching that a result costs while all workers are busy and work waits, with so many workers.
fn steps_a_result(workers: u32) -> f64 {
    let mut rig = Rig::new();
    for worker in 0..workers {
        rig.connect(&format!("w{worker}"), 1);
    }
    rig.submit("long", 20 * workers, 20);
    let a_round_of_results = |rig: &mut Rig| {
        for _ in 0..workers {
            let given = rig.take().expect("work waits");
            let mut completed = given.completed(given.delivery());
            completed.compute = Duration::from_millis(50) * given.range().count;
            rig.complete(completed);
        }
        rig.scheduler.queue.room.steps
    };
    // Every worker has worked once: tasks are known to be short, and some is handed out in advance.
    let before = a_round_of_results(&mut rig);
    (a_round_of_results(&mut rig) - before) as f64 / f64::from(workers)
}

#[test]
fn cost_of_result_is_constant_in_workers() {
    let (few, many) = (steps_a_result(10), steps_a_result(1000));
    assert!(many <= few + 2.0, "{few} steps with 10 workers, {many} with 1000");
}

/// Looks that a heartbeat of an idle worker costs while as many others are busy.
fn steps_a_heartbeat(busy: u32) -> f64 {
    let mut rig = Rig::new();
    let workers: Vec<String> = (0..2 * busy).map(|worker| format!("w{worker}")).collect();
    let sessions: Vec<SessionId> = workers.iter().map(|id| rig.connect(id, 1)).collect();
    rig.submit("wide", busy, 2);
    let given = rig.take().expect("work");
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
    let (few, many) = (steps_a_heartbeat(10), steps_a_heartbeat(500));
    assert!(many <= few + 2.0, "{few} looks with 10 ranges out, {many} with 500");
}

/// Looks that a result costs while a suspect waits for a worker that has nothing else, with so many workers.
fn steps_beside_a_suspect(workers: u32) -> f64 {
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
    let dead = WorkerId("w0".into());
    on_disconnect(&mut rig.scheduler, rig.now, &dead, sessions[0]);
    rig.given.retain(|g| g.worker != dead);
    rig.advance(LEASE / 5);
    let cell = rig.scheduler.queue.cells.values().next().expect("one is kept free").clone();
    let before = rig.scheduler.queue.room.steps;
    for _ in 1..workers {
        let other = rig.given.iter().position(|g| g.worker != cell).expect("work");
        result(&mut rig, other);
    }
    assert!(rig.scheduler.queue.cells.values().eq([&cell]), "it is still waited for");
    (rig.scheduler.queue.room.steps - before) as f64 / f64::from(workers - 1)
}

#[test]
fn waiting_suspect_costs_no_scan_of_workers() {
    let (few, many) = (steps_beside_a_suspect(10), steps_beside_a_suspect(500));
    assert!(many <= few + 2.0, "{few} looks with 10 workers, {many} with 500");
}

#[test]
fn leases_lost_together_are_written_once() {
    let mut rig = Rig::new();
    rig.submit("a", 200, 1);
    for worker in 0..100 {
        let session = rig.connect(&format!("w{worker}"), 2);
        rig.disconnect(&format!("w{worker}"), session);
    }
    rig.settle();
    rig.now.since_start += LEASE;
    on_tick(&mut rig.scheduler, rig.now);
    let written = rig.scheduler.take_actions().iter().filter(|a| matches!(a, Action::Write(_))).count();
    assert_eq!(written, 1);
}

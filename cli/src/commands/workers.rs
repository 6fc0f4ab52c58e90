//! `evogait workers`: workers that are connected to a coordinator.

use crate::client::{Client, Url};
use crate::console::{self, table};
use crate::error::Error;
use crate::view::{WorkerView, hex};

/// Prints the connected workers.
pub async fn run(on: Url, json: bool) -> Result<(), Error> {
    let mut client = Client::connect(&on).await?;
    let workers = client.workers().await?;
    if json {
        return console::say_json(&workers.iter().map(WorkerView::new).collect::<Vec<_>>());
    }
    if workers.is_empty() {
        return console::say(&format!("no workers at {on}: start some with `worker --coordinator {on} --slots N`"));
    }
    let rows: Vec<Vec<String>> = workers
        .iter()
        .map(|w| {
            vec![
                w.name.clone(),
                w.address.clone(),
                format!("{}/{}", w.busy, w.slots),
                console::count(w.tasks),
                console::moment(w.connected_at_ms),
                w.engine_digests
                    .iter()
                    .map(|d| hex(d).chars().take(12).collect::<String>())
                    .collect::<Vec<_>>()
                    .join(" "),
                w.reason.clone(),
            ]
        })
        .collect();
    console::say(&table(
        &["name", "address", "busy", "tasks", "connected (UTC)", "engines", "gets no work because"],
        &rows,
    ))
}

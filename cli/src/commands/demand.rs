//! `evogait demand`: number of slots that a coordinator's jobs can use, for scripts that start and stop workers.

use crate::client::{Client, Url};
use crate::console;
use crate::error::Error;
use crate::view::DemandView;

/// Prints the numbers of wanted, existing and busy slots.
pub async fn run(on: Url, json: bool) -> Result<(), Error> {
    let demand = DemandView::new(&Client::connect(&on).await?.demand().await?);
    if json {
        return console::say_json(&demand);
    }
    let DemandView { wanted, slots, busy } = demand;
    console::say(&format!("{wanted} slots wanted, {slots} connected, {busy} busy"))
}

//! `evogait demand`: how many slots a coordinator's jobs could use, for those who start and stop workers.

use crate::client::{Client, Url};
use crate::console;
use crate::error::Error;
use crate::view::DemandView;

/// Prints the numbers.
pub async fn run(on: Url, json: bool) -> Result<(), Error> {
    let demand = DemandView::new(&Client::connect(&on).await?.demand().await?);
    if json {
        return console::say_json(&demand);
    }
    let DemandView { wanted, slots, busy } = demand;
    console::say(&format!("{wanted} slots wanted, {slots} there, {busy} busy"))
}

//! `evogait health`: health of a coordinator, from the gRPC health service; or of a process, from its `/healthz`.

use crate::arguments::{Health, HealthOf};
use crate::client::Client;
use crate::console;
use crate::error::{Error, plain};
use serde::Serialize;
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// Time limit for the answer of a process; without an answer it counts as unhealthy.
const TIMEOUT: Duration = Duration::from_secs(3);
/// Maximum length of an answer of `/healthz`, bytes.
const MAX_ANSWER: u64 = 4096;

#[derive(Serialize)]
struct HealthView {
    /// True if a coordinator serves, or a process is healthy.
    well: bool,
    /// Status as text, from the process or the coordinator.
    says: String,
}

/// Requests the health and prints it. Returns an error if it is bad.
pub async fn run(args: Health, quiet: bool) -> Result<(), Error> {
    let (view, unwell) = match args.of {
        HealthOf::Coordinator { on, alive } => {
            let serving = Client::connect(&on).await?.serving().await?;
            let says = if serving { "serving" } else { "standing by" }.to_owned();
            let unwell = (!serving && !alive).then(|| Error::StandsBy { url: on.to_string() });
            (HealthView { well: unwell.is_none(), says }, unwell)
        }
        HealthOf::Process(address) => {
            let silent = |reason: String| Error::Unwell { address, reason };
            let (well, says) = healthz(address).map_err(|e| match e.kind() {
                ErrorKind::WouldBlock | ErrorKind::TimedOut => {
                    silent(format!("no answer within {} s", TIMEOUT.as_secs()))
                }
                _ => silent(format!("{}; give the address of its --metrics", plain(&e))),
            })?;
            let unwell = (!well).then(|| silent(says.clone()));
            (HealthView { well, says }, unwell)
        }
    };
    if args.json {
        console::say_json(&view)?;
    } else if !quiet && unwell.is_none() {
        console::say(&view.says)?;
    }
    unwell.map_or(Ok(()), Err)
}

/// Returns true if the process is healthy, and the text of its answer.
fn healthz(address: SocketAddr) -> io::Result<(bool, String)> {
    let mut stream = TcpStream::connect_timeout(&address, TIMEOUT)?;
    stream.set_read_timeout(Some(TIMEOUT))?;
    let request = format!("GET /healthz HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes())?;
    let mut answer = String::new();
    stream.take(MAX_ANSWER).read_to_string(&mut answer)?;
    let no_http = || io::Error::new(ErrorKind::InvalidData, "the answer is not that of a --metrics address");
    let (head, body) = answer.split_once("\r\n\r\n").ok_or_else(no_http)?;
    let code = head.strip_prefix("HTTP/1.1 ").and_then(|h| h.get(..3)).ok_or_else(no_http)?;
    Ok((code == "200", body.trim().to_owned()))
}

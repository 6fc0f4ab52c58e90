//! `evogait certs`: certificates and tokens for a small cluster.

use crate::arguments::{Certs, CertsAction};
use crate::certs::{self, CA_DAYS, Host};
use crate::console;
use crate::error::Error;
use proto::credentials::authority;

/// Creates or renews the certificates, and prints the next steps.
pub fn run(args: Certs, quiet: bool) -> Result<(), Error> {
    let Certs { action, folder, hosts: given, days } = args;
    let hosts = with_loopback(given);
    match action {
        CertsAction::Init => certs::init(&folder, &hosts, days)?,
        CertsAction::Renew => certs::renew(&folder, &hosts, days)?,
    }
    if quiet {
        return Ok(());
    }
    let names = hosts.iter().map(Host::to_string).collect::<Vec<_>>().join(", ");
    let until = authority(&folder.join("ca.pem")).map(|ca| ca.valid_until).unwrap_or_default();
    let file = |name: &str| console::quoted(folder.join(name).display());
    let [ca, tokens] = ["ca.pem", "tokens"].map(file);
    let [coordinator, coordinator_key] = ["coordinator.pem", "coordinator.key"].map(file);
    let [worker, worker_key, worker_token] = ["worker.pem", "worker.key", "worker.token"].map(file);
    let [client, client_key, client_token] = ["client.pem", "client.key", "client.token"].map(file);
    let dir = folder.display();
    let host = hosts.iter().find(|host| !is_loopback(host)).unwrap_or(&hosts[0]);
    let host = if let Host::Ip(std::net::IpAddr::V6(ip)) = host { format!("[{ip}]") } else { host.to_string() };
    let valid = format!(
        "The certificates in {dir} are valid for {days} days, the CA until {until}. The coordinator's certificate is for {names}."
    );
    console::say(&match action {
        CertsAction::Renew => {
            format!("{valid}\nCopy them to the machines that use them and restart the programs there.")
        }
        CertsAction::Init => format!(
            "{valid}
ca.key signs further certificates: keep it offline. (A new CA is valid for {CA_DAYS} days.)

The coordinator needs coordinator.pem, coordinator.key, ca.pem and tokens:
  coordinator --listen 0.0.0.0:7077 --store sqlite:evogait.db --tls-cert {coordinator} \\
    --tls-key {coordinator_key} --client-ca {ca} --tokens {tokens}
A worker needs ca.pem, worker.pem, worker.key and worker.token:
  worker --coordinator https://{host}:7077 --ca {ca} --cert {worker} \\
    --key {worker_key} --token-file {worker_token}
A client needs ca.pem, client.pem, client.key and client.token:
  evogait workers --coordinator https://{host}:7077 --ca {ca} --cert {client} \\
    --key {client_key} --token-file {client_token}
Or set EVOGAIT_COORDINATOR, EVOGAIT_CA, EVOGAIT_CERT, EVOGAIT_KEY and EVOGAIT_TOKEN_FILE."
        ),
    })
}

fn is_loopback(host: &Host) -> bool {
    match host {
        Host::Name(name) => name == "localhost",
        Host::Ip(ip) => ip.is_loopback(),
    }
}

/// Adds the names of the machine itself, so that local programs can connect.
fn with_loopback(mut hosts: Vec<Host>) -> Vec<Host> {
    for own in [
        Host::Name("localhost".to_owned()),
        Host::Ip(std::net::Ipv4Addr::LOCALHOST.into()),
        Host::Ip(std::net::Ipv6Addr::LOCALHOST.into()),
    ] {
        if !hosts.contains(&own) {
            hosts.push(own);
        }
    }
    hosts
}

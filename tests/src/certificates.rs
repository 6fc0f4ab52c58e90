//! Certificates and tokens of a small cluster, as `evogait certs init` makes them, and how each side is told of them.

use crate::sandbox::{output_of, program};
use proto::credentials::{Credentials, Sources};
use proto::dial::Dial;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A folder of them.
#[derive(Clone, Debug)]
pub struct Certificates(PathBuf);

impl Certificates {
    /// Makes them in a folder that is not there yet.
    pub fn make(folder: &Path) -> Self {
        let made = output_of(program("evogait").args(["certs", "init"]).arg(folder));
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        let told = String::from_utf8_lossy(&made.stdout);
        assert!(told.contains("valid for 365 days") && told.contains("--token-file"), "{told}");
        Self(folder.to_owned())
    }

    /// One of them.
    pub fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// The secret in `client.token`, `worker.token` or `admin.token`.
    pub fn token(&self, who: &str) -> String {
        let file = self.file(&format!("{who}.token"));
        fs::read_to_string(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display())).trim().to_owned()
    }

    /// Lets a coordinator ask for certificates and tokens.
    pub fn close(&self, coordinator: &mut Command) {
        for (option, file) in [
            ("--tls-cert", "coordinator.pem"),
            ("--tls-key", "coordinator.key"),
            ("--client-ca", "ca.pem"),
            ("--tokens", "tokens"),
        ] {
            coordinator.arg(option).arg(self.file(file));
        }
    }

    /// Lets a client or a worker show its own, and believe the CA.
    pub fn show(&self, command: &mut Command, who: &str) {
        command.arg("--ca").arg(self.file("ca.pem"));
        command.arg("--cert").arg(self.file(&format!("{who}.pem"))).arg("--key").arg(self.file(&format!("{who}.key")));
        command.arg("--token-file").arg(self.file(&format!("{who}.token")));
    }

    /// Dials with somebody's certificate and somebody's token, or without.
    pub fn dial(&self, addresses: &str, certificate: Option<&str>, token: Option<&str>) -> Dial {
        let sources = Sources {
            ca: Some(self.file("ca.pem")),
            cert: certificate.map(|who| self.file(&format!("{who}.pem"))),
            key: certificate.map(|who| self.file(&format!("{who}.key"))),
            token_file: token.map(|who| self.file(&format!("{who}.token"))),
        };
        let credentials = Credentials::read(sources, |_| None).expect("they can be read");
        Dial::new(closed(addresses).parse().expect("they are addresses"), &credentials).expect("they fit the addresses")
    }
}

/// The same addresses behind closed doors.
pub fn closed(addresses: &str) -> String {
    addresses.replace("http://", "https://")
}

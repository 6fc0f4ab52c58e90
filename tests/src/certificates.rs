//! Certificates and tokens of a small cluster, as `evogait certs init` makes them, and the options that pass them to
//! programs.

use crate::sandbox::{output_of, program};
use proto::credentials::{Credentials, Sources};
use proto::dial::Dial;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Folder of certificates, keys and tokens.
#[derive(Clone, Debug)]
pub struct Certificates(PathBuf);

impl Certificates {
    /// Makes certificates and tokens in a new folder.
    pub fn make(folder: &Path) -> Self {
        let made = output_of(program("evogait").args(["certs", "init"]).arg(folder));
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        let told = String::from_utf8_lossy(&made.stdout);
        assert!(told.contains("valid for 365 days") && told.contains("--token-file"), "{told}");
        Self(folder.to_owned())
    }

    /// Returns the path of a file in the folder.
    pub fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Returns the secret in `client.token`, `worker.token` or `admin.token`.
    pub fn token(&self, who: &str) -> String {
        let file = self.file(&format!("{who}.token"));
        fs::read_to_string(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display())).trim().to_owned()
    }

    /// Makes a coordinator require certificates and tokens.
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

    /// Makes a client or worker show its own certificate and token, and trust the CA.
    pub fn show(&self, command: &mut Command, who: &str) {
        command.arg("--ca").arg(self.file("ca.pem"));
        command.arg("--cert").arg(self.file(&format!("{who}.pem"))).arg("--key").arg(self.file(&format!("{who}.key")));
        command.arg("--token-file").arg(self.file(&format!("{who}.token")));
    }

    /// Returns a dial with the certificate and token of the given roles. None: without.
    pub fn dial(&self, addresses: &str, certificate: Option<&str>, token: Option<&str>) -> Dial {
        let sources = Sources {
            ca: Some(self.file("ca.pem")),
            cert: certificate.map(|who| self.file(&format!("{who}.pem"))),
            key: certificate.map(|who| self.file(&format!("{who}.key"))),
            token_file: token.map(|who| self.file(&format!("{who}.token"))),
        };
        let credentials = Credentials::read(sources, |_| None).expect("the certificates and the token can be read");
        Dial::new(closed(addresses).parse().expect("the addresses are valid"), &credentials)
            .expect("the credentials are valid for these addresses")
    }
}

/// Returns the same addresses with `https://`.
pub fn closed(addresses: &str) -> String {
    addresses.replace("http://", "https://")
}

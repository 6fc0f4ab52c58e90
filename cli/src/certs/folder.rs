//! Folder of certificates, keys and tokens. Secret files are created with mode 0600, before their content is written.

use super::make::{Host, Pair, Signer, authority};
use crate::error::Error;
use crate::inputs;
use proto::credentials::{PemError, Token};
use sha2::{Digest as _, Sha256};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::path::Path;

/// Roles that get a token.
const ROLES: [&str; 3] = ["client", "worker", "admin"];
/// Roles that get a client certificate.
const CALLERS: [&str; 2] = ["client", "worker"];

/// Creates a CA, certificates that are valid for `days` days, and tokens. Fails if one of the files exists.
pub fn init(folder: &Path, hosts: &[Host], days: u32) -> Result<(), Error> {
    let made = |e: rcgen::Error| Error::write(folder, io::Error::other(e));
    fs::create_dir_all(folder).map_err(|e| Error::write(folder, e))?;
    let ca = authority().map_err(made)?;
    let mut files = vec![("ca.pem".to_owned(), ca.cert.clone(), false), ("ca.key".to_owned(), ca.key.clone(), true)];
    files.extend(certificates(&ca, hosts, days).map_err(made)?);
    let mut tokens = "# A role and a token a line, or sha256: and a token's digest. Reread on SIGHUP.\n".to_owned();
    for role in ROLES {
        let token = Token::random();
        let digest: [u8; 32] = Sha256::digest(token.reveal()).into();
        let hex: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
        tokens += &format!("{role} sha256:{hex}\n");
        files.push((format!("{role}.token"), format!("{}\n", token.reveal()), true));
    }
    files.push(("tokens".to_owned(), tokens, true));
    if let Some((name, ..)) = files.iter().find(|(name, ..)| folder.join(name).exists()) {
        let taken = io::Error::other("the file exists and is not replaced: choose another folder");
        return Err(Error::write(&folder.join(name), taken));
    }
    for (name, content, secret) in &files {
        let path = folder.join(name);
        write_new(&path, content, *secret).map_err(|e| Error::write(&path, e))?;
    }
    Ok(())
}

/// Replaces the certificates and keys of a folder by new ones of the same CA. Tokens and CA stay.
pub fn renew(folder: &Path, hosts: &[Host], days: u32) -> Result<(), Error> {
    let read = |name: &str| {
        let path = folder.join(name);
        let text = fs::read_to_string(&path).map_err(|e| Error::read(&path, e))?;
        inputs::record(&path);
        Ok::<_, Error>(text)
    };
    let ca = Pair { cert: read("ca.pem")?, key: read("ca.key")? };
    let unusable = |name: &str, reason: String| Error::read(&folder.join(name), io::Error::other(reason));
    proto::credentials::authority(&folder.join("ca.pem")).map_err(|e| match e {
        PemError::Expired { day, .. } => {
            unusable("ca.pem", format!("the CA expired on {day}: create a new one with `evogait certs init`"))
        }
        other => Error::Usage { message: other.to_string() },
    })?;
    let made = |e: rcgen::Error| unusable("ca.key", format!("it is not the private key of the CA in PEM ({e})"));
    let files = certificates(&ca, hosts, days).map_err(made)?;
    inputs::refuse_all(folder, files.iter().map(|(name, ..)| name.as_str()))?;
    for (name, content, secret) in &files {
        let (path, temporary) = (folder.join(name), folder.join(format!(".{name}.{}.tmp", std::process::id())));
        let written = write_new(&temporary, content, *secret).and_then(|()| fs::rename(&temporary, &path));
        written.map_err(|e| {
            // Best effort: the error of the write is reported.
            let _ = fs::remove_file(&temporary);
            Error::write(&path, e)
        })?;
    }
    Ok(())
}

/// File name, content, and true for a secret.
type Content = (String, String, bool);

fn certificates(ca: &Pair, hosts: &[Host], days: u32) -> Result<Vec<Content>, rcgen::Error> {
    let signer = Signer::new(ca, days)?;
    let mut pairs = vec![("coordinator", signer.server("evogait coordinator", hosts)?)];
    for caller in CALLERS {
        pairs.push((caller, signer.client(&format!("evogait {caller}"))?));
    }
    let files = |(name, pair): (&str, Pair)| {
        // Key first: a certificate is useless without it.
        [(format!("{name}.key"), pair.key, true), (format!("{name}.pem"), pair.cert, false)]
    };
    Ok(pairs.into_iter().flat_map(files).collect())
}

fn write_new(path: &Path, content: &str, secret: bool) -> io::Result<()> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt as _;
        options.mode(if secret { 0o600 } else { 0o644 });
    }
    let mut file: File = options.open(path)?;
    file.write_all(content.as_bytes())?;
    file.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::credentials::{authority, identity};

    fn local() -> Vec<Host> {
        vec!["localhost".parse().unwrap(), "127.0.0.1".parse().unwrap()]
    }

    fn mode(path: &Path) -> u32 {
        use std::os::unix::fs::PermissionsExt as _;
        fs::metadata(path).unwrap().permissions().mode() & 0o777
    }

    #[test]
    fn created_files_are_consistent_and_secrets_private() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join("certs").join(name);
        init(&folder.path().join("certs"), &local(), 30).unwrap();
        authority(&at("ca.pem")).unwrap();
        for name in ["coordinator", "client", "worker"] {
            identity(&at(&format!("{name}.pem")), &at(&format!("{name}.key"))).unwrap();
            assert_eq!(mode(&at(&format!("{name}.key"))), 0o600);
        }
        let access = coordinator::Access::read(&at("tokens")).unwrap();
        for role in [coordinator::Role::Client, coordinator::Role::Worker, coordinator::Role::Admin] {
            let path = at(&format!("{role}.token"));
            assert_eq!(access.role(Token::read(&path).unwrap().reveal().as_bytes()), Some(role));
            assert_eq!(mode(&path), 0o600);
        }
        assert_eq!((mode(&at("ca.key")), mode(&at("tokens")), mode(&at("ca.pem")) & 0o444), (0o600, 0o600, 0o444));
    }

    #[test]
    fn init_replaces_nothing_and_renew_replaces_certificates() {
        let folder = tempfile::tempdir().unwrap();
        init(folder.path(), &local(), 30).unwrap();
        let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
        let before = ["ca.key", "worker.pem", "tokens"].map(read);
        let refused = init(folder.path(), &local(), 30).unwrap_err().to_string();
        assert!(refused.contains("ca.pem") && refused.contains("not replaced"), "{refused}");
        assert_eq!(["ca.key", "worker.pem", "tokens"].map(read), before);
        renew(folder.path(), &local(), 60).unwrap();
        let after = ["ca.key", "worker.pem", "tokens"].map(read);
        assert_eq!((&after[0], &after[2]), (&before[0], &before[2]));
        assert_ne!(after[1], before[1]);
        let at = |name: &str| folder.path().join(name);
        let fresh = identity(&at("worker.pem"), &at("worker.key")).unwrap();
        let ca = authority(&at("ca.pem")).unwrap();
        assert!(fresh.valid_until < ca.valid_until, "{fresh:?} {ca:?}");
    }

    #[test]
    fn unusable_certificate_error_names_file_and_fault() {
        let folder = tempfile::tempdir().unwrap();
        init(folder.path(), &local(), 30).unwrap();
        let at = |name: &str| folder.path().join(name);
        let refused = |cert: &str, key: &str| identity(&at(cert), &at(key)).unwrap_err().to_string();
        let text = refused("worker.pem", "client.key");
        assert!(
            text.contains("client.key is not the key of the certificate in") && text.contains("worker.pem"),
            "{text}"
        );
        assert!(refused("tokens", "client.key").contains("tokens holds no certificate in PEM"));
        assert!(refused("client.pem", "tokens").contains("tokens holds no private key in PEM"));
        assert!(refused("client.pem", "none").contains("can't read") && refused("none", "client.key").contains("none"));
        let text = authority(&at("client.pem")).unwrap_err().to_string();
        assert!(text.contains("client.pem is not that of a CA"), "{text}");
        let whole = fs::read_to_string(at("client.pem")).unwrap();
        let lines: Vec<&str> = whole.lines().collect();
        fs::write(at("damaged.pem"), [lines[0], lines[1], lines[lines.len() - 1]].join("\n")).unwrap();
        let text = refused("damaged.pem", "client.key");
        assert!(text.contains("damaged.pem can't be used"), "{text}");
        // Certificates that expire at once.
        renew(folder.path(), &local(), 0).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(1100));
        let text = refused("client.pem", "client.key");
        assert!(text.contains("client.pem expired on 2") && text.contains("certs renew"), "{text}");
        // A bundle of several CAs is valid as long as one of them is.
        let old = super::super::make::authority_for(0).unwrap().cert;
        fs::write(at("old.pem"), &old).unwrap();
        fs::write(at("both.pem"), old + &fs::read_to_string(at("ca.pem")).unwrap()).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(1100));
        let text = authority(&at("old.pem")).unwrap_err().to_string();
        assert!(text.contains("old.pem expired on 2"), "{text}");
        assert_eq!(authority(&at("both.pem")).unwrap().valid_until, authority(&at("ca.pem")).unwrap().valid_until);
    }
}

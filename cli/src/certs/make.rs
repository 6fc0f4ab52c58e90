//! Certificates and keys in memory. Keys are ECDSA on P-256, which all TLS implementations support.

use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose,
    SanType,
};
use std::fmt;
use std::net::IpAddr;
use std::str::FromStr;
use time::{Duration, OffsetDateTime};

/// Validity of a CA, days.
pub const CA_DAYS: u32 = 3650;
/// Tolerance for clock differences between machines: certificates are valid from this long ago on.
const CLOCKS_DIFFER: Duration = Duration::HOUR;

/// Host name or address of a coordinator.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Host {
    Name(String),
    Ip(IpAddr),
}

impl FromStr for Host {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Ok(ip) = text.trim_start_matches('[').trim_end_matches(']').parse() {
            return Ok(Self::Ip(ip));
        }
        let label = |l: &str| {
            let inner = |b: u8| b.is_ascii_alphanumeric() || b == b'-' || b == b'_';
            (1..=63).contains(&l.len()) && l.bytes().all(inner) && !l.starts_with('-') && !l.ends_with('-')
        };
        let first_may_be_any = text.strip_prefix("*.").unwrap_or(text);
        if text.len() <= 253 && first_may_be_any.split('.').all(label) {
            return Ok(Self::Name(text.to_owned()));
        }
        Err(format!(
            "'{text}' is not a host: write a name or an IP address without scheme and port, such as node7.example"
        ))
    }
}

impl fmt::Display for Host {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Name(name) => f.write_str(name),
            Self::Ip(ip) => ip.fmt(f),
        }
    }
}

/// Certificate and its key, both in PEM.
pub struct Pair {
    pub cert: String,
    pub key: String,
}

/// Creates a CA that may sign end certificates only.
pub fn authority() -> Result<Pair, rcgen::Error> {
    authority_for(CA_DAYS)
}

/// Creates a CA that is valid for `days` days.
pub fn authority_for(days: u32) -> Result<Pair, rcgen::Error> {
    let mut params = params("evogait CA", days);
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    let key = KeyPair::generate()?;
    Ok(Pair { cert: params.self_signed(&key)?.pem(), key: key.serialize_pem() })
}

/// Signer of certificates for a CA.
pub struct Signer {
    issuer: Issuer<'static, KeyPair>,
    days: u32,
}

impl Signer {
    /// Creates a signer; its certificates are valid for `days` days.
    pub fn new(authority: &Pair, days: u32) -> Result<Self, rcgen::Error> {
        let key = KeyPair::from_pem(&authority.key)?;
        Ok(Self { issuer: Issuer::from_ca_cert_pem(&authority.cert, key)?, days })
    }

    /// Creates the certificate of a coordinator, valid for all of `hosts`.
    pub fn server(&self, name: &str, hosts: &[Host]) -> Result<Pair, rcgen::Error> {
        let mut params = params(name, self.days);
        for host in hosts {
            params.subject_alt_names.push(match host {
                Host::Name(name) => SanType::DnsName(name.as_str().try_into()?),
                Host::Ip(ip) => SanType::IpAddress(*ip),
            });
        }
        self.leaf(params, ExtendedKeyUsagePurpose::ServerAuth)
    }

    /// Creates the certificate of a client or a worker.
    pub fn client(&self, name: &str) -> Result<Pair, rcgen::Error> {
        self.leaf(params(name, self.days), ExtendedKeyUsagePurpose::ClientAuth)
    }

    fn leaf(&self, mut params: CertificateParams, purpose: ExtendedKeyUsagePurpose) -> Result<Pair, rcgen::Error> {
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![purpose];
        params.use_authority_key_identifier_extension = true;
        let key = KeyPair::generate()?;
        Ok(Pair { cert: params.signed_by(&key, &self.issuer)?.pem(), key: key.serialize_pem() })
    }
}

fn params(name: &str, days: u32) -> CertificateParams {
    let now = OffsetDateTime::now_utc();
    let mut params = CertificateParams::default();
    params.distinguished_name.push(DnType::CommonName, name);
    params.not_before = now - CLOCKS_DIFFER;
    params.not_after = now + Duration::days(days.into());
    params
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn host_parses_names_and_addresses_only() {
        assert_eq!("10.0.0.7".parse(), Ok(Host::Ip("10.0.0.7".parse().unwrap())));
        assert_eq!("[fd00::1]".parse(), Ok(Host::Ip("fd00::1".parse().unwrap())));
        for name in ["node7", "node7.example", "*.cluster.local", "a_b"] {
            assert_eq!(name.parse(), Ok(Host::Name(name.to_owned())));
        }
        let long = "a".repeat(64);
        for wrong in ["", "a b", "https://a", "a:7077", "-a", "a..b", "*", "a.*.b", "é", "/etc/passwd", long.as_str()]
        {
            assert!(wrong.parse::<Host>().is_err(), "{wrong}");
        }
    }
}

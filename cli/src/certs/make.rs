//! Certificates and keys in memory. Keys are ECDSA on P-256, which all TLS stacks know.

use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose,
    SanType,
};
use std::fmt;
use std::net::IpAddr;
use std::str::FromStr;
use time::{Duration, OffsetDateTime};

/// How long a CA is valid, days.
pub const CA_DAYS: u32 = 3650;
/// Clocks of machines differ: certificates are valid from this long ago on.
const CLOCKS_DIFFER: Duration = Duration::HOUR;

/// A name or an address under which a coordinator is dialed.
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
            "'{text}' is no host: write a name or an IP address, without scheme and port, such as node7.example"
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

/// A certificate and its key, both PEM.
pub struct Pair {
    pub cert: String,
    pub key: String,
}

/// A CA that signs nothing but what [`Signer`] is asked for.
pub fn authority() -> Result<Pair, rcgen::Error> {
    authority_for(CA_DAYS)
}

/// One that is valid for so many days.
pub fn authority_for(days: u32) -> Result<Pair, rcgen::Error> {
    let mut params = params("evogait CA", days);
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    let key = KeyPair::generate()?;
    Ok(Pair { cert: params.self_signed(&key)?.pem(), key: key.serialize_pem() })
}

/// Signs with a CA.
pub struct Signer {
    issuer: Issuer<'static, KeyPair>,
    days: u32,
}

impl Signer {
    /// Takes a CA; what it signs is valid so many days.
    pub fn new(authority: &Pair, days: u32) -> Result<Self, rcgen::Error> {
        let key = KeyPair::from_pem(&authority.key)?;
        Ok(Self { issuer: Issuer::from_ca_cert_pem(&authority.cert, key)?, days })
    }

    /// A coordinator's, for all hosts under which it is dialed.
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

    /// A client's or a worker's.
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
    fn hosts_are_names_and_addresses_and_nothing_else() {
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

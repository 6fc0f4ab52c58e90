//! Addresses of coordinators: `http://HOST:PORT` or `https://HOST:PORT`, several of them separated by commas.

use http::Uri;
use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;

/// Largest number of addresses of a coordinator and its standbys.
pub const MAX_ADDRESSES: usize = 16;

/// Addresses of a coordinator and its standbys, 1 to [`MAX_ADDRESSES`], tried in this order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Addresses(Vec<Address>);

/// Address of a coordinator.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// URL without a path: `https://HOST:PORT`.
    pub url: String,
    /// True for `https`.
    pub tls: bool,
    /// True if the address is on this machine. A host name counts as another machine, except `localhost`.
    pub loopback: bool,
}

/// Invalid addresses of a coordinator.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BadAddress {
    /// Text that is not a URL of the required form.
    #[error(
        "'{text}' is not the address of a coordinator: write https://HOST:PORT (or http://HOST:PORT on this machine), such as \
         http://127.0.0.1:7077; several are separated by commas"
    )]
    Form {
        /// Given text.
        text: String,
    },
    /// Too many addresses.
    #[error("{found} coordinator addresses are given: at most {MAX_ADDRESSES} are allowed")]
    TooMany {
        /// Number of given addresses.
        found: usize,
    },
}

impl Addresses {
    /// Returns all addresses in order.
    pub fn all(&self) -> &[Address] {
        &self.0
    }
}

impl From<SocketAddr> for Addresses {
    /// Creates the address of a coordinator without TLS.
    fn from(socket: SocketAddr) -> Self {
        Self(vec![Address { url: format!("http://{socket}"), tls: false, loopback: socket.ip().is_loopback() }])
    }
}

impl FromStr for Addresses {
    type Err = BadAddress;

    fn from_str(text: &str) -> Result<Self, BadAddress> {
        let found = text.split(',').count();
        if found > MAX_ADDRESSES {
            return Err(BadAddress::TooMany { found });
        }
        text.split(',').map(|part| address(part.trim())).collect::<Result<_, _>>().map(Self)
    }
}

impl fmt::Display for Addresses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.iter().map(|a| a.url.as_str()).collect::<Vec<_>>().join(","))
    }
}

fn address(text: &str) -> Result<Address, BadAddress> {
    let wrong = || BadAddress::Form { text: text.to_owned() };
    let uri: Uri = text.trim_end_matches('/').parse().map_err(|_| wrong())?;
    let tls = match uri.scheme_str() {
        Some("https") => true,
        Some("http") => false,
        _ => return Err(wrong()),
    };
    let authority = uri.authority().ok_or_else(wrong)?;
    let host = authority.host();
    let bare = matches!(uri.path(), "" | "/") && uri.query().is_none() && !authority.as_str().contains('@');
    if host.is_empty() || authority.port_u16().is_none() || !bare {
        return Err(wrong());
    }
    let ip = host.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
    let loopback = ip.map_or(host.eq_ignore_ascii_case("localhost"), |ip| ip.is_loopback());
    let scheme = if tls { "https" } else { "http" };
    Ok(Address { url: format!("{scheme}://{authority}"), tls, loopback })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Addresses, BadAddress> {
        text.parse()
    }

    #[test]
    fn address_without_scheme_or_port_is_refused() {
        assert_eq!(parse("http://127.0.0.1:7077/").unwrap().to_string(), "http://127.0.0.1:7077");
        let two = parse("https://a.example:7077, https://[fd00::1]:7078").unwrap();
        assert_eq!(two.to_string(), "https://a.example:7077,https://[fd00::1]:7078");
        assert!(two.all().iter().all(|a| a.tls && !a.loopback));
        for wrong in [
            "",
            ",",
            "127.0.0.1:7077",
            "http://host",
            "http://host:port",
            "http://host:70777",
            "http://:1",
            "ftp://a:1",
            "http://a b:1",
            "http://a:1/path",
            "http://user@a:1",
            "http://a:1,",
            "sqlite:x",
        ] {
            assert!(matches!(parse(wrong), Err(BadAddress::Form { .. })), "{wrong}");
        }
        let many = vec!["http://a:1"; MAX_ADDRESSES + 1].join(",");
        assert_eq!(parse(&many), Err(BadAddress::TooMany { found: MAX_ADDRESSES + 1 }));
    }

    #[test]
    fn only_addresses_of_this_machine_are_loopback() {
        for here in ["http://127.0.0.1:1", "http://127.8.8.8:1", "http://[::1]:1", "http://localhost:1"] {
            assert!(parse(here).unwrap().all()[0].loopback, "{here}");
        }
        for elsewhere in ["http://10.0.0.1:1", "http://[::2]:1", "http://localhost.example:1", "http://0.0.0.0:1"] {
            assert!(!parse(elsewhere).unwrap().all()[0].loopback, "{elsewhere}");
        }
    }
}

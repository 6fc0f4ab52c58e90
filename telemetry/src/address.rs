//! Parser of addresses to listen on: an IP address or a host name, and a port.

use std::net::{Ipv4Addr, SocketAddr, ToSocketAddrs as _};

/// Reads `ADDRESS:PORT` or `NAME:PORT`. `localhost` is 127.0.0.1. If a name has several addresses, one that other
/// machines can reach is preferred, so that the rules for such addresses apply. Among equal addresses IPv4 is
/// preferred.
pub fn address(text: &str) -> Result<SocketAddr, String> {
    if let Ok(address) = text.parse() {
        return Ok(address);
    }
    let form = || "write an IP address or a host name and a port, such as 127.0.0.1:7077 or localhost:7077".to_owned();
    let (name, port) = text.rsplit_once(':').ok_or_else(form)?;
    let port: u16 = port.parse().map_err(|_| form())?;
    if name.is_empty() || name.contains(|c: char| !(c.is_alphanumeric() || "-_.".contains(c))) {
        return Err(form());
    }
    if name.eq_ignore_ascii_case("localhost") {
        return Ok((Ipv4Addr::LOCALHOST, port).into());
    }
    let found = (name, port).to_socket_addrs().map_err(|e| format!("the name \"{name}\" has no address: {e}"))?;
    chosen(found).ok_or_else(|| format!("the name \"{name}\" has no address"))
}

fn chosen(found: impl Iterator<Item = SocketAddr>) -> Option<SocketAddr> {
    found.min_by_key(|address| (address.ip().is_loopback(), address.is_ipv6()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_numbers_are_addresses() {
        for (text, expected) in [
            ("127.0.0.1:7077", "127.0.0.1:7077"),
            ("[::1]:0", "[::1]:0"),
            ("localhost:7077", "127.0.0.1:7077"),
            ("LocalHost:0", "127.0.0.1:0"),
        ] {
            assert_eq!(address(text), Ok(expected.parse().unwrap()), "{text}");
        }
    }

    #[test]
    fn text_that_is_no_address_is_refused() {
        for wrong in
            ["", "7077", "localhost", ":7077", "localhost:", "localhost:70000", "http://localhost:7077", "a b:1"]
        {
            assert!(address(wrong).unwrap_err().contains("such as 127.0.0.1:7077"), "{wrong}");
        }
    }

    #[test]
    fn name_with_external_address_is_not_loopback() {
        let chosen = |all: &[&str]| chosen(all.iter().map(|a| a.parse().unwrap())).map(|a| a.to_string());
        assert_eq!(chosen(&["127.0.0.1:1", "10.0.0.1:1"]).as_deref(), Some("10.0.0.1:1"));
        assert_eq!(chosen(&["[::1]:1", "[fe80::1]:1"]).as_deref(), Some("[fe80::1]:1"));
        assert_eq!(chosen(&["[::1]:1", "127.0.0.1:1"]).as_deref(), Some("127.0.0.1:1"));
        assert_eq!(chosen(&[]), None);
    }
}

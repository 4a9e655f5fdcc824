//! [`AddressGuard`]: resolves the names of servers, and keeps what a public server leads to off private
//! networks.
//!
//! A page or playlist from the internet could otherwise make the player send requests to the devices of a
//! home network, as browsers prevent, too (Private Network Access). The guard checks the addresses that the
//! connection then uses, so a name that resolves to a public address first and to a private one later does
//! not pass. Behind a proxy it is the proxy that resolves names, and only addresses in URLs are checked.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use ureq::config::Config;
use ureq::http::Uri;
use ureq::unversioned::resolver::{DefaultResolver, ResolvedSocketAddrs, Resolver};
use ureq::unversioned::transport::NextTimeout;

use crate::clips::Servers;

/// Where the servers of a fetch are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Network {
    /// Not known: no name was resolved, or a proxy does that.
    #[default]
    Unknown,
    /// All addresses of the latest server are private, link-local or loopback.
    Local,
    /// Some address is of the internet.
    Public,
}

/// The addresses of a fetch.
#[derive(Debug)]
pub(super) struct Addresses {
    servers: Servers,
    is_public: fn(IpAddr) -> bool,
    latest: Mutex<Network>,
    /// Whether an address was refused since the latest request began.
    was_refused: AtomicBool,
}

impl Addresses {
    pub(super) fn new(servers: Servers) -> Arc<Addresses> {
        Addresses::with(servers, is_public)
    }

    /// With a test for addresses of the internet.
    pub(super) fn with(servers: Servers, is_public: fn(IpAddr) -> bool) -> Arc<Addresses> {
        Arc::new(Addresses {
            servers,
            is_public,
            latest: Mutex::new(Network::Unknown),
            was_refused: AtomicBool::new(false),
        })
    }

    /// Begins a request for the file.
    pub(super) fn begin(&self) {
        self.set_latest(Network::Unknown);
        self.was_refused.store(false, Ordering::Relaxed);
    }

    /// Where the latest server is.
    pub(super) fn latest(&self) -> Network {
        *self.latest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether an address was refused.
    pub(super) fn was_refused(&self) -> bool {
        self.was_refused.load(Ordering::Relaxed)
    }

    fn set_latest(&self, network: Network) {
        *self.latest.lock().unwrap_or_else(PoisonError::into_inner) = network;
    }

    /// Takes in the addresses of the next server, and leaves those that may be connected to.
    fn admit(&self, addresses: &[IpAddr]) -> Vec<bool> {
        let is_public: Vec<bool> = addresses.iter().map(|address| (self.is_public)(*address)).collect();
        let is_guarded = match self.servers {
            Servers::All => false,
            Servers::Public => true,
            // A redirect from a public address.
            Servers::Guarded => self.latest() == Network::Public,
        };
        let some_public = is_public.contains(&true);
        self.set_latest(if some_public { Network::Public } else { Network::Local });
        if !is_guarded {
            return vec![true; addresses.len()];
        }
        self.was_refused.fetch_or(!some_public, Ordering::Relaxed);
        is_public
    }

    /// Takes in a server that is not resolved here; whether it may be connected to.
    pub(super) fn admit_unresolved(&self, host: &str) -> bool {
        match host.trim_start_matches('[').trim_end_matches(']').parse() {
            Ok(address) => self.admit(&[address]) == [true],
            Err(_) => true,
        }
    }
}

/// The resolver that checks [`Addresses`].
#[derive(Debug)]
pub(super) struct AddressGuard<R = DefaultResolver> {
    pub(super) addresses: Arc<Addresses>,
    pub(super) resolver: R,
}

impl<R: Resolver> Resolver for AddressGuard<R> {
    fn resolve(
        &self,
        uri: &Uri,
        config: &Config,
        timeout: NextTimeout,
    ) -> Result<ResolvedSocketAddrs, ureq::Error> {
        let resolved = self.resolver.resolve(uri, config, timeout)?;
        // The user named the proxy.
        if config.proxy().is_some_and(|proxy| proxy.uri() == uri) {
            return Ok(resolved);
        }
        let addresses: Vec<IpAddr> = resolved.iter().map(|address| address.ip()).collect();
        let admitted = self.addresses.admit(&addresses);
        let mut left = self.empty();
        for (address, _) in resolved.iter().zip(admitted).filter(|(_, is_admitted)| *is_admitted) {
            left.push(*address);
        }
        match left.is_empty() {
            true => Err(ureq::Error::HostNotFound),
            false => Ok(left),
        }
    }
}

/// Whether an address is of the internet: neither private, link-local or loopback, nor reserved otherwise
/// (IANA's special-purpose address registries).
pub(super) fn is_public(address: IpAddr) -> bool {
    match address {
        IpAddr::V4(address) => is_public_v4(address),
        IpAddr::V6(address) => is_public_v6(address),
    }
}

fn is_public_v4(address: Ipv4Addr) -> bool {
    let [a, b, c, _] = address.octets();
    let is_special = match a {
        // This network, private, loopback, multicast and reserved.
        0 | 10 | 127 | 224.. => true,
        // Shared by the customers of a provider.
        100 => b & 0xc0 == 64,
        169 => b == 254,
        172 => b & 0xf0 == 16,
        // Private, protocols, documentation.
        192 => b == 168 || b == 0 && (c == 0 || c == 2),
        // Benchmarks, documentation.
        198 => b & 0xfe == 18 || (b, c) == (51, 100),
        203 => (b, c) == (0, 113),
        _ => false,
    };
    !is_special
}

fn is_public_v6(address: Ipv6Addr) -> bool {
    let [a, b, c, d, e, f, g, h] = address.segments();
    let v4 = |high: u16, low: u16| is_public_v4(Ipv4Addr::from(u32::from(high) << 16 | u32::from(low)));
    match (a, b) {
        // Addresses of version 4: mapped, translated, and tunnelled (6to4).
        (0, 0) => (c, d, e, f) == (0, 0, 0, 0xffff) && v4(g, h),
        (0x64, 0xff9b) => (c, d, e, f) == (0, 0, 0, 0) && v4(g, h),
        (0x2002, _) => v4(b, c),
        // Protocols, documentation.
        (0x2001, 0..0x200 | 0xdb8) | (0x3fff, 0..0x1000) => false,
        _ => a & 0xe000 == 0x2000,
    }
}

#[cfg(test)]
mod tests {
    use std::net::SocketAddr;

    use ureq::Proxy;

    use super::*;

    #[test]
    fn addresses_are_public_or_special() {
        for address in [
            "1.1.1.1",
            "9.255.255.255",
            "11.0.0.0",
            "100.63.0.1",
            "100.128.0.1",
            "126.0.0.1",
            "128.0.0.1",
            "169.253.0.1",
            "172.15.0.1",
            "172.32.0.1",
            "192.0.1.1",
            "192.167.0.1",
            "198.17.0.1",
            "198.20.0.1",
            "203.0.112.1",
            "223.255.255.255",
            "2600::1",
            "2001:4860::8888",
            "2002:101:101::1",
            "::ffff:1.1.1.1",
            "64:ff9b::1.1.1.1",
            "2a00::",
            "3ffe::1",
        ] {
            assert!(is_public(address.parse().unwrap()), "{address}");
        }
        for address in [
            "0.0.0.0",
            "10.1.2.3",
            "100.64.0.1",
            "100.127.255.255",
            "127.0.0.1",
            "127.255.0.1",
            "169.254.169.254",
            "172.16.0.1",
            "172.31.255.255",
            "192.0.0.1",
            "192.0.2.1",
            "192.168.1.1",
            "198.18.0.1",
            "198.19.0.1",
            "198.51.100.1",
            "203.0.113.1",
            "224.0.0.1",
            "240.0.0.1",
            "255.255.255.255",
            "::",
            "::1",
            "fe80::1",
            "fc00::1",
            "fdff::1",
            "fec0::1",
            "ff02::1",
            "100::1",
            "::ffff:10.0.0.1",
            "::ffff:127.0.0.1",
            "::10.0.0.1",
            "64:ff9b::192.168.1.1",
            "64:ff9b:1::1",
            "2001::1",
            "2001:1ff::1",
            "2001:db8::1",
            "2002:a00:1::1",
            "3fff:fff::1",
            "4000::1",
        ] {
            assert!(!is_public(address.parse().unwrap()), "{address}");
        }
    }

    /// Takes 127.0.0.1 for an address of the internet.
    fn first_loopback_is_public(address: IpAddr) -> bool {
        address == IpAddr::V4(Ipv4Addr::LOCALHOST)
    }

    #[test]
    fn a_public_address_leads_to_public_ones_only() {
        let [public, private] = ["127.0.0.1", "127.0.0.2"].map(|address| address.parse().unwrap());
        let admitted = |servers, hops: &[&[IpAddr]]| {
            let addresses = Addresses::with(servers, first_loopback_is_public);
            let admitted: Vec<bool> = hops.iter().flat_map(|hop| addresses.admit(hop)).collect();
            (admitted, addresses.was_refused(), addresses.latest())
        };
        use Network::{Local, Public};
        assert_eq!(admitted(Servers::Guarded, &[&[private]]), (vec![true], false, Local));
        assert_eq!(admitted(Servers::Guarded, &[&[private], &[public]]), (vec![true; 2], false, Public));
        assert_eq!(admitted(Servers::Guarded, &[&[public], &[private]]), (vec![true, false], true, Local));
        assert_eq!(admitted(Servers::All, &[&[public], &[private]]), (vec![true; 2], false, Local));
        assert_eq!(admitted(Servers::Public, &[&[private]]), (vec![false], true, Local));
        assert_eq!(admitted(Servers::Public, &[&[private, public]]), (vec![false, true], false, Public));
        let addresses = Addresses::new(Servers::Public);
        assert!(addresses.admit_unresolved("name") && addresses.latest() == Network::Unknown);
        assert!(addresses.admit_unresolved("1.1.1.1") && !addresses.admit_unresolved("[::1]"));
        assert!(addresses.was_refused() && addresses.latest() == Local);
    }

    /// Every name has the address 127.0.0.1.
    #[derive(Debug)]
    struct Loopback;

    impl Resolver for Loopback {
        fn resolve(&self, _: &Uri, _: &Config, _: NextTimeout) -> Result<ResolvedSocketAddrs, ureq::Error> {
            let mut addresses = self.empty();
            addresses.push(SocketAddr::from((Ipv4Addr::LOCALHOST, 80)));
            Ok(addresses)
        }
    }

    #[test]
    fn a_proxy_may_have_a_private_address() {
        let proxy = Proxy::new("http://proxy:3128").unwrap();
        let config = Config::builder().proxy(Some(proxy.clone())).build();
        let addresses = Addresses::new(Servers::Public);
        let guard = AddressGuard { addresses: addresses.clone(), resolver: Loopback };
        let resolve = |uri: &Uri| guard.resolve(uri, &config, NextTimeout::default());
        assert_eq!(resolve(proxy.uri()).unwrap().len(), 1);
        assert!(!addresses.was_refused() && addresses.latest() == Network::Unknown);
        assert!(matches!(resolve(&Uri::from_static("http://host/")), Err(ureq::Error::HostNotFound)));
        assert!(addresses.was_refused() && addresses.latest() == Network::Local);
    }
}

//! What the operator allows: whether there are webhooks at all, and hosts whose addresses are not checked.

use std::net::IpAddr;

use url::Host;

use super::WebhookUrl;
use super::address::refused_kind;

/// The rules for the receivers of webhooks.
#[derive(Clone, Debug, Default)]
pub(crate) struct WebhookRules {
    enabled: bool,
    names: Vec<String>,
    addresses: Vec<IpAddr>,
}

impl WebhookRules {
    /// `enabled` where there is a secret to sign with; `allowed` are names and addresses of hosts to which webhooks may
    /// be sent wherever they are, as [`allowed_host`] reads them.
    pub(crate) fn new(enabled: bool, allowed: &[String]) -> Self {
        let mut rules = Self { enabled, ..Self::default() };
        for host in allowed.iter().map(|host| host.to_ascii_lowercase()) {
            match host.parse::<IpAddr>() {
                Ok(address) => rules.addresses.push(address.to_canonical()),
                Err(_) => rules.names.push(host.trim_end_matches('.').to_owned()),
            }
        }
        rules
    }

    /// Whether there are webhooks.
    pub(crate) fn enabled(&self) -> bool {
        self.enabled
    }

    /// Checks the URL of a submission. A name is resolved, and its addresses are checked, when the webhook is sent.
    ///
    /// # Errors
    /// Why it is refused.
    pub(crate) fn check(&self, url: &WebhookUrl) -> Result<(), String> {
        if !self.enabled {
            let detail = "this server sends no webhooks: leave this field out, or start the server with the option \
                          --webhook-secret-file";
            return Err(detail.into());
        }
        match url.host() {
            Host::Domain(_) => Ok(()),
            Host::Ipv4(address) => self.check_address(url, (*address).into()),
            Host::Ipv6(address) => self.check_address(url, (*address).into()),
        }
    }

    /// Judges an address that the host of a URL has.
    ///
    /// # Errors
    /// Why it is refused.
    pub(crate) fn check_address(&self, url: &WebhookUrl, address: IpAddr) -> Result<(), String> {
        let name_allowed = match url.host() {
            Host::Domain(name) => {
                let name = name.trim_end_matches('.');
                self.names.iter().any(|allowed| allowed == name)
            }
            Host::Ipv4(_) | Host::Ipv6(_) => false,
        };
        if name_allowed || self.addresses.contains(&address.to_canonical()) {
            return Ok(());
        }
        match refused_kind(address) {
            None => Ok(()),
            Some(kind) => Err(format!(
                "the address {address} is refused ({kind}): must be a public address, or a host that the server allows \
                 with --webhook-allowed-host"
            )),
        }
    }
}

/// Reads an allowed host: a name or an address, without scheme and port.
///
/// # Errors
/// What is wrong, in one sentence.
pub(crate) fn allowed_host(text: &str) -> Result<String, String> {
    let host = text.trim().trim_start_matches('[').trim_end_matches(']');
    let of_a_name = |c: char| c.is_ascii_alphanumeric() || "-._".contains(c);
    let is_name = host.chars().all(of_a_name) && Host::parse(host).is_ok();
    let known = is_name || host.parse::<IpAddr>().is_ok();
    if known {
        Ok(host.to_owned())
    } else {
        Err("must be a name or an address, without scheme and port".into())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn url(text: &str) -> WebhookUrl {
        WebhookUrl::parse(text).unwrap()
    }

    #[test]
    fn literal_addresses_are_checked_at_submission_and_names_later() {
        let rules = WebhookRules::new(true, &[]);
        for refused in
            ["http://127.0.0.1/", "http://[::1]:80/", "http://169.254.169.254/x", "http://2130706433/"]
        {
            let fault = rules.check(&url(refused)).unwrap_err();
            assert!(fault.contains("is refused") && fault.contains("--webhook-allowed-host"), "{fault}");
        }
        let good =
            ["http://hooks.example/", "https://hooks.example/", "http://localhost/", "http://1.1.1.1/"];
        for accepted in good {
            assert_eq!(rules.check(&url(accepted)), Ok(()), "{accepted}");
        }
        let fault = WebhookRules::new(false, &[]).check(&url("https://hooks.example/")).unwrap_err();
        assert!(fault.contains("--webhook-secret-file"), "{fault}");
    }

    #[test]
    fn an_allowed_name_has_any_address_and_an_allowed_address_any_name() {
        let allowed = ["Hooks.Example", " 10.0.0.5", "[::1]"].map(|host| allowed_host(host).unwrap());
        for bad in ["", "http://hooks.example", "hooks.example:80", "hooks.example/x", "10.0.0.0/8", "*"] {
            assert!(allowed_host(bad).is_err(), "{bad}");
        }
        let rules = WebhookRules::new(true, &allowed);
        let is_allowed =
            |text: &str, address: &str| rules.check_address(&url(text), address.parse().unwrap()).is_ok();
        assert!(is_allowed("http://hooks.example/", "192.168.0.1"));
        assert!(is_allowed("http://HOOKS.example./", "127.0.0.1"));
        assert!(is_allowed("http://other.example/", "10.0.0.5"));
        assert!(is_allowed("http://other.example/", "::ffff:10.0.0.5"));
        assert!(is_allowed("http://[::1]/", "::1"));
        assert!(!is_allowed("http://other.example/", "10.0.0.6"));
        assert!(!is_allowed("http://x.hooks.example/", "127.0.0.1"));
        assert!(!is_allowed("http://other.example/", "127.0.0.1"));
    }
}

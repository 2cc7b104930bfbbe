//! Names of hosts in requests.

use axum::http::{HeaderMap, HeaderValue, header};

/// The host that a request names, with its port if it has one: letters, digits, dots, dashes, and
/// the brackets and colons of addresses. `None` when it names another thing.
pub(super) fn host(headers: &HeaderMap) -> Option<&str> {
    let host = text(headers.get(header::HOST))?;
    let is_plain = |c: char| c.is_ascii_alphanumeric() || ".-:[]".contains(c);
    (!host.is_empty() && host.chars().all(is_plain)).then_some(host)
}

/// A host without its port.
pub(super) fn name(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|digit| digit.is_ascii_digit()) => name,
        _ => host,
    }
}

/// A header's value as text.
pub(super) fn text(value: Option<&HeaderValue>) -> Option<&str> {
    value.and_then(|value| value.to_str().ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_is_told_from_its_port_and_from_what_is_no_host() {
        let names = ["house.example", "house.example:4777", "[::1]:4777", "[::1]", "192.0.2.1:80"];
        let bare = names.map(name);
        assert_eq!(bare, ["house.example", "house.example", "[::1]", "[::1]", "192.0.2.1"]);
        let of = |value: &'static str| {
            let headers = HeaderMap::from_iter([(header::HOST, HeaderValue::from_static(value))]);
            host(&headers).map(str::to_owned)
        };
        assert_eq!(of("house.example:4777").as_deref(), Some("house.example:4777"));
        assert_eq!((of("a;script-src *"), of("")), (None, None));
    }
}

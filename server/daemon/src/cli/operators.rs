//! The listener for operators, as `serve` starts it.

#[cfg(feature = "http")]
use std::io::{IsTerminal, stdout};
use std::path::Path;

#[cfg(feature = "http")]
use anyhow::Context;
#[cfg(feature = "http")]
use sightline_server::http::{HttpServer, OwnerToken};
use sightline_server::net::{HttpAddress, Limits, Server};

/// Starts to listen for operators, if they have an address. Dropping the result ends
/// it. That the address of the default is taken is a warning only: another server may run here.
#[cfg(feature = "http")]
pub async fn listen(
    server: &Server,
    http: HttpAddress,
    limits: &Limits,
    data: &Path,
) -> anyhow::Result<Option<HttpServer>> {
    let HttpAddress::At(address) = http else { return Ok(None) };
    let token = OwnerToken::keep(data)
        .with_context(|| format!("cannot keep the owner's token in {}", data.display()))?;
    let listened = HttpServer::listen(address, server, token.clone(), limits).await;
    let listened = listened
        .with_context(|| format!("cannot listen on {address}; choose another with --http ADDR"));
    let listener = match listened {
        Err(error) if http.is_default() => {
            let error = sightline_cli::output::one_line(&error);
            tracing::warn!("nothing for operators: {error}");
            return Ok(None);
        }
        listened => listened?,
    };
    let address = listener.local_addr();
    // A person gets a link by which they may act; a log gets none.
    let act = if stdout().is_terminal() { format!("/#token={token}") } else { String::new() };
    sightline_cli::output::print(&format!("{:<27}http://{address}{act}\n", "for operators:"))?;
    if !address.ip().is_loopback() {
        tracing::warn!("http://{address} has no password: whoever reaches it sees where all are");
    }
    Ok(Some(listener))
}

/// Does nothing: this program was built without the feature `http`.
#[cfg(not(feature = "http"))]
pub async fn listen(_: &Server, http: HttpAddress, _: &Limits, _: &Path) -> anyhow::Result<()> {
    if matches!(http, HttpAddress::At(_)) && !http.is_default() {
        anyhow::bail!("--http: this program was built without the feature http");
    }
    Ok(())
}

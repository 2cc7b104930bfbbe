//! The listener for visitors with a browser, as `serve` starts it.

#[cfg(feature = "web")]
use anyhow::Context;
use sightline_server::net::{Server, WebAddress};
#[cfg(feature = "web")]
use sightline_server::web::WebServer;

#[cfg(feature = "web")]
use super::joining::{host, own_address};

/// Starts to listen for browsers, unless that is off, and tells the link. Dropping the result ends
/// it. That the port is taken is a warning only, unless it was chosen for browsers.
#[cfg(feature = "web")]
pub fn listen(server: &Server, web: WebAddress) -> anyhow::Result<Option<WebServer>> {
    let Some(address) = web.beside(server.local_addr()?) else { return Ok(None) };
    let listened = WebServer::listen(address, server.web_door()?);
    let listened = listened
        .with_context(|| format!("cannot listen on TCP {address}; choose another with --web ADDR"));
    let listener = match listened {
        Err(error) if web == WebAddress::Same => {
            let error = sightline_cli::output::one_line(&error);
            tracing::warn!("nothing for browsers: {error}");
            return Ok(None);
        }
        listened => listened?,
    };
    sightline_cli::output::print(&links(&listener))?;
    Ok(Some(listener))
}

/// The links by which people come.
#[cfg(feature = "web")]
fn links(listener: &WebServer) -> String {
    let address = listener.local_addr();
    let row = |from: &str, host: String| {
        format!("{from:<27}{}://{host}:{}\n", listener.scheme(), address.port())
    };
    if !address.ip().is_unspecified() {
        return row("in a browser:", host(address.ip()));
    }
    let here = row("in a browser here:", "localhost".to_owned());
    let there = own_address().map(|own| row("in a browser elsewhere:", host(own)));
    here + &there.unwrap_or_default()
}

/// Does nothing: this program was built without the feature `web`.
#[cfg(not(feature = "web"))]
pub fn listen(_: &Server, web: WebAddress) -> anyhow::Result<()> {
    if matches!(web, WebAddress::At(_)) {
        anyhow::bail!("--web: this program was built without the feature web");
    }
    Ok(())
}

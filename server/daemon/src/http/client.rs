//! Asks a running server what it does.

use std::{net::SocketAddr, time::Duration};

use axum::{
    body::{Body, Bytes},
    http::{Request, header},
};
use http_body_util::{BodyExt, Limited};
use hyper::client::conn::http1;
use hyper_util::rt::TokioIo;
use tokio::{net::TcpStream, time::timeout};

use crate::operate::Overview;

/// How long an answer may take.
const PATIENCE: Duration = Duration::from_secs(10);
/// The longest answer, in bytes: more than 16,384 clients take.
const ANSWER_BYTES_MAX: usize = 32 << 20;

/// Why a server does not say what it does.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AskError {
    /// Nobody answers there.
    #[error(
        "no server answers at http://{address}: {why}; name the address that `serve` prints for \
         operators"
    )]
    Unreachable {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        why: String,
    },
    /// The server has nothing to say at the moment.
    #[error("the server at http://{address} answers {status}")]
    Status {
        /// The address.
        address: SocketAddr,
        /// What it answers, in words.
        status: String,
    },
    /// What answers is no server of this version.
    #[error("what answers at http://{address} is no Sightline server of this version: {why}")]
    Foreign {
        /// The address.
        address: SocketAddr,
        /// What is wrong with the answer.
        why: String,
    },
}

/// Asks the server that listens for operators at an address. Must be called within a tokio runtime.
///
/// # Errors
/// When nobody answers in time, or the answer is not that of a server.
pub async fn ask_overview(address: SocketAddr) -> Result<Overview, AskError> {
    let unreachable = |why: &dyn std::fmt::Display| {
        let why = why.to_string();
        AskError::Unreachable { address, why }
    };
    let answered = timeout(PATIENCE, ask(address)).await;
    let answered = answered.map_err(|_| unreachable(&"it takes too long"))?;
    let (status, body) = answered.map_err(|error| unreachable(&error))?;
    if !status.is_success() {
        return Err(AskError::Status { address, status: status.to_string() });
    }
    let foreign = |error: serde_json::Error| AskError::Foreign { address, why: error.to_string() };
    serde_json::from_slice(&body).map_err(foreign)
}

async fn ask(
    address: SocketAddr,
) -> Result<(axum::http::StatusCode, Bytes), Box<dyn std::error::Error + Send + Sync>> {
    let stream = TokioIo::new(TcpStream::connect(address).await?);
    let (mut sender, connection) = http1::handshake(stream).await?;
    let request = Request::get(super::OVERVIEW_PATH)
        .header(header::HOST, address.to_string())
        .body(Body::empty())?;
    // The connection ends with its sender, also where the server would keep it.
    let answered = async move {
        let response = sender.send_request(request).await?;
        let status = response.status();
        let body = Limited::new(response.into_body(), ANSWER_BYTES_MAX).collect().await?;
        Ok((status, body.to_bytes()))
    };
    let (answer, _) = tokio::join!(answered, connection);
    answer
}

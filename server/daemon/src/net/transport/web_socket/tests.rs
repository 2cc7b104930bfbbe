//! A page that does not read.

use std::time::Instant;

use axum::{Router, extract::WebSocketUpgrade, routing::get};
use futures_util::StreamExt;
use tokio::{net::TcpListener, time::sleep};
use tokio_tungstenite::{connect_async, tungstenite::Message};

use super::*;

const POSES: [u8; 1_000] = [7; 1_000];
/// How long a path is full before nothing more is believed to fit.
const FULL_FOR: Duration = Duration::from_millis(300);

/// Sends poses whenever there is room for them, until there has been none for a while. How many.
async fn fill(transport: &WebSocketTransport) -> usize {
    let (mut sent, mut last) = (0, Instant::now());
    while last.elapsed() < FULL_FOR {
        if transport.datagram_room().is_some() {
            transport.send_datagram(&POSES).unwrap();
            (sent, last) = (sent + 1, Instant::now());
        }
        sleep(Duration::from_millis(1)).await;
    }
    sent
}

#[tokio::test(flavor = "multi_thread")]
async fn poses_wait_in_the_outbox_while_a_page_does_not_read() {
    let (opened, mut open) = mpsc::channel(1);
    let upgrade = move |upgrade: WebSocketUpgrade| async move {
        upgrade.on_upgrade(async move |socket| {
            let address = "127.0.0.1:9".parse().unwrap();
            let transport = WebSocketTransport::new(socket, address, Duration::from_secs(60));
            let _ = opened.send(transport).await;
        })
    };
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("ws://{}/", listener.local_addr().unwrap());
    let server =
        tokio::spawn(axum::serve(listener, Router::new().route("/", get(upgrade))).into_future());
    let (mut page, _) = connect_async(url).await.unwrap();
    let transport = open.recv().await.unwrap();

    let sent = fill(&transport).await;
    assert!(sent > 0 && transport.datagram_room().is_none());
    let mut read = 0;
    while read < sent {
        let message = page.next().await.unwrap().unwrap();
        if let Message::Binary(bytes) = message {
            assert_eq!((bytes[0], &bytes[1..]), (DATAGRAM, &POSES[..]));
            read += 1;
        }
    }
    let began = Instant::now();
    while transport.datagram_room().is_none() {
        assert!(began.elapsed() < Duration::from_secs(20), "there is room again");
        sleep(Duration::from_millis(1)).await;
    }
    assert!(transport.link.poses().waiting.is_empty(), "none were kept");
    server.abort();
}

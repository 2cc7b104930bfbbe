//! Peers that take more than their share.

use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

use sightline_protocol::{
    VERSION, frame,
    message::{ClientMessage, Refusal, ServerMessage},
    text::ChatLine,
};
use sightline_server::net::{Limits, ServeConfig};

use super::{config, join, options, serve, until};
use crate::{
    building::{EAST, WEST},
    stranger::{Stranger, hello, hello_and_enter},
};
use sightline_client::net::{ConnectError, Dialer};

/// A deadline that begins anew with each byte would never pass.
#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_reads_byte_by_byte_is_dropped() {
    let (server, address) = serve(config());
    let stranger = Stranger::with_stream_window(address, 64).await;
    let (mut send, mut receive) = stranger.connection.open_bi().await.unwrap();
    let text = ChatLine::new(&"x".repeat(256)).unwrap();
    let chat = frame::encode(&ClientMessage::Chat { text });
    send.write_all(&hello_and_enter()).await.unwrap();
    let is_in = || server.stats().clients.values().any(|client| client.reporting_state.is_some());
    until("the stranger is in the world", is_in).await;
    send.write_all(&chat.repeat(5)).await.unwrap();
    let dribble = async {
        let mut byte = [0];
        while receive.read_exact(&mut byte).await.is_ok() {
            tokio::time::sleep(Duration::from_secs(1)).await;
        }
    };
    // What has arrived can be read after the end, too.
    tokio::select! {
        () = stranger.is_closed() => {}
        () = dribble => {}
    }
    until("nobody is left", || server.stats().clients.is_empty()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_never_enters_takes_nobodys_place() {
    let (server, address) = serve(ServeConfig { clients_max: 1, ..config() });
    let idle = Stranger::connect(address).await;
    let _idle = idle.send(&hello(VERSION)).await;
    until("the stranger is welcome", || server.stats().clients.len() == 1).await;
    let ada = join(&server, "Ada", WEST).await;
    let refused = Dialer::new(None).connect(address, &options(&server, "Bo", EAST)).await;
    assert!(matches!(refused.err().unwrap(), ConnectError::Refused(_)));
    assert_eq!(ada.end(), None);
}

/// A visitor without a key cannot be known again, nor kept out.
#[tokio::test(flavor = "multi_thread")]
async fn a_client_without_a_key_is_refused() {
    let (_server, address) = serve(config());
    let stranger = Stranger::without_key(address).await;
    let said = stranger.converse(&hello(VERSION)).await;
    assert_eq!(said, [ServerMessage::Refused { reason: Refusal::NoKey }]);
}

/// Ids that ascend would tell everybody how many come.
#[tokio::test(flavor = "multi_thread")]
async fn avatar_ids_do_not_tell_how_many_came() {
    let (_server, address) = serve(config());
    let mut ids = Vec::new();
    for _ in 0..6 {
        let stranger = Stranger::connect(address).await;
        let goodbye = frame::encode(&ClientMessage::Goodbye);
        let said = stranger.converse(&[hello(VERSION), goodbye].concat()).await;
        match said[..] {
            [ServerMessage::Welcome { avatar, .. }, ..] => ids.push(avatar.0),
            _ => panic!("the stranger is not welcome: {said:?}"),
        }
    }
    assert!(!ids.is_sorted(), "{ids:?}");
}

/// A limit of the configuration is kept, and what it refuses is counted under its name.
#[tokio::test(flavor = "multi_thread")]
async fn limits_can_be_set_and_count_what_they_refuse() {
    let text = "chat_per_s = 0.01\nchat_burst = 1\nenter_s = 0.3\nmessages_tolerated = 1\n";
    let limits = ServeConfig::from_toml(&format!("[limits]\n{text}")).unwrap().limits;
    let (server, address) = serve(ServeConfig { limits, ..config() });
    let http = super::operators::listen(&server, &Limits::default()).await;
    let ada = join(&server, "Ada", WEST).await;
    for line in ["one", "two", "three"] {
        ada.chat(line).unwrap();
    }
    let idle = Stranger::connect(address).await;
    let _idle = idle.send(&hello(VERSION)).await;
    let loud = Stranger::connect(address).await;
    let nothing = frame::encode(&ClientMessage::FetchWorld { world: 0 });
    let _loud = loud.send(&[hello_and_enter(), nothing.repeat(300)].concat()).await;
    let junk = Stranger::connect(address).await;
    let _junk = junk.send(&[0xff; 64]).await;
    for stranger in [idle, loud, junk] {
        stranger.is_closed().await;
    }
    let refused = |metrics: &BTreeMap<String, f64>| {
        let count = |name: &str| metrics[&format!("sightline_refused_total{{reason=\"{name}\"}}")];
        ["chat_per_s", "enter_s", "messages_tolerated", "malformed"].map(count)
    };
    let start = Instant::now();
    let mut counts = [0.0; 4];
    while counts != [2.0, 1.0, 1.0, 1.0] && start.elapsed() < Duration::from_secs(20) {
        tokio::time::sleep(Duration::from_millis(100)).await;
        counts = refused(&super::operators::metrics(http.local_addr()).await);
    }
    assert_eq!(counts, [2.0, 1.0, 1.0, 1.0]);
    assert_eq!(ada.end(), None);
}

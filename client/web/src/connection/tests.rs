use std::num::NonZeroU32;

use sightline_fixtures::voxel_floor;
use sightline_protocol::{message::HeadOffer, text::Name};

use super::*;

/// A moment, in milliseconds.
fn at(milliseconds: u64) -> Duration {
    Duration::from_millis(milliseconds)
}

fn client() -> Connection {
    Connection::new(Hello::new("Ada", 0x00ff_8000, &[7; 32], "").unwrap())
}

/// Gives a client messages, as one piece of the stream.
fn tell(client: &mut Connection, messages: &[ServerMessage]) {
    let bytes: Vec<u8> = messages.iter().flat_map(frame::encode).collect();
    client.control(at(20), &bytes);
}

/// What a client has said since the last call.
fn said(client: &mut Connection) -> Vec<ClientMessage> {
    let mut frames = FrameBuffer::default();
    frames.push(&client.take_control());
    let mut said = Vec::new();
    while let Some(frame) = frames.next_frame().unwrap() {
        said.push(ClientMessage::decode(frame).unwrap());
    }
    said
}

fn welcome(avatar: u32) -> ServerMessage {
    let tick_interval_us = NonZeroU32::new(50_000).unwrap();
    ServerMessage::Welcome { avatar: AvatarId(avatar), tick_interval_us }
}

/// A world's file and its offer.
fn world(number: u32, boxes: &[([u32; 3], [u32; 3], u8)]) -> (Vec<u8>, ServerMessage) {
    let bytes = voxel_floor::world(boxes).to_bytes();
    let id = content_id(&bytes).unwrap().0;
    let offer = ServerMessage::World { number, id, bytes: bytes.len() as u64, head: None };
    (bytes, offer)
}

fn entered() -> ServerMessage {
    let pose = Pose { eye: voxel_floor::SPAWN.eye, ..Pose::default() };
    ServerMessage::Entered { pose: (&pose).into(), tick: 5 }
}

/// A client in a world.
fn present() -> (Connection, Vec<u8>, ServerMessage) {
    let mut client = client();
    let (bytes, offer) = world(1, &[]);
    client.opened(at(0));
    tell(&mut client, &[welcome(1), offer.clone()]);
    client.give(&bytes);
    tell(&mut client, &[entered()]);
    (client, bytes, offer)
}

#[test]
fn a_client_says_hello_gets_the_world_and_enters_it() {
    let mut client = client();
    client.opened(at(0));
    assert!(matches!(&said(&mut client)[..], [ClientMessage::Hello { colour: [255, 128, 0], .. }]));
    let what = ChatLine::new("it compiles").unwrap();
    tell(&mut client, &[welcome(1), ServerMessage::Loading { what }]);
    assert_eq!(client.stage(), &Stage::Waiting("it compiles".to_owned()));
    let (bytes, offer) = world(3, &[]);
    tell(&mut client, &[offer]);
    assert_eq!(client.wanted(), content_id(&bytes).ok().map(Wanted::File));
    let other = world(1, &[([0, 2, 0], [4, 8, 4], 0)]).0;
    client.give(&other);
    assert_eq!(client.stage(), &Stage::Fetching, "another world is not what was wanted");
    client.give(&bytes);
    assert!(matches!(said(&mut client)[..], [ClientMessage::Enter { world: 3, place: None, .. }]));
    tell(&mut client, &[entered()]);
    assert!(client.is_in() && client.wanted().is_none());
    assert!(matches!(client.take_events()[..], [Event::Entered(_)]));
}

#[test]
fn who_comes_back_needs_no_world_anew_and_goes_on_where_it_was() {
    let (mut client, _, offer) = present();
    let stood = Pose { eye: voxel_floor::SPAWN.eye + glam::Vec3::X, ..Pose::default() };
    client.set_pose(at(30), stood);
    client.closed(at(40), "the network went away");
    assert_eq!(client.stage(), &Stage::Closed("the network went away".to_owned()));
    client.opened(at(900));
    tell(&mut client, &[welcome(8), offer]);
    let messages = said(&mut client);
    let [ClientMessage::Hello { .. }, ClientMessage::Enter { place: Some(place), .. }] =
        &messages[..]
    else {
        panic!("{messages:?}")
    };
    assert!(glam::Vec3::from(*place).distance(stood.eye) < 0.01);
    tell(&mut client, &[entered()]);
    assert!(client.is_in());
    assert_eq!(client.presence().map(Presence::returns), Some(1));
}

#[test]
fn a_changed_building_is_entered_on_the_same_connection() {
    let (mut client, ..) = present();
    said(&mut client);
    let (bytes, offer) = world(2, &[([0, 2, 0], [4, 8, 4], 0)]);
    tell(&mut client, &[offer]);
    assert_eq!(client.stage(), &Stage::Fetching);
    client.give(&bytes);
    assert!(matches!(said(&mut client)[..], [ClientMessage::Enter { world: 2, .. }]));
    assert_eq!(client.presence().map(Presence::returns), Some(0));
}

#[test]
fn why_the_server_ended_it_stays_known_after_the_socket_closes() {
    for (message, may_pass, is_version) in [
        (ServerMessage::Refused { reason: Refusal::Banned }, false, false),
        (ServerMessage::Refused { reason: Refusal::Busy { retry_ms: 700 } }, true, false),
        (ServerMessage::Refused { reason: Refusal::Version { server: 99 } }, false, true),
        (entered(), false, false),
    ] {
        let mut client = client();
        client.opened(at(0));
        tell(&mut client, &[message]);
        client.closed(at(50), "the socket closed");
        let Stage::Over(ending) = client.stage() else { panic!("{:?}", client.stage()) };
        assert_eq!((ending.may_pass, ending.is_version), (may_pass, is_version), "{ending:?}");
        assert!(!ending.reason.contains("socket"), "{ending:?}");
    }
    let (mut client, ..) = present();
    client.control(at(60), &[255, 255, 1]);
    assert!(matches!(client.stage(), Stage::Over(Ending { may_pass: false, .. })));
}

#[test]
fn lines_are_said_only_in_a_world_and_datagrams_do_not_pile_up() {
    let mut client = client();
    assert!(client.say("anybody?").is_err());
    let (mut client, ..) = present();
    said(&mut client);
    assert!(client.say("").is_err());
    client.say("hello").unwrap();
    assert!(matches!(said(&mut client)[..], [ClientMessage::Chat { .. }]));
    let order =
        sightline_world::motion::Tolerance { metres: 0.0, radians: 0.0, ahead: Duration::ZERO };
    tell(&mut client, &[ServerMessage::Live { tolerance: (&order).into() }]);
    for tick in 1..100 {
        let eye = voxel_floor::SPAWN.eye + glam::Vec3::X * 0.1 * tick as f32;
        client.set_pose(at(50 * tick), Pose { eye, ..Pose::default() });
        client.tick(at(50 * tick));
    }
    let datagrams = std::iter::from_fn(|| client.take_datagram()).count();
    assert_eq!(datagrams, DATAGRAMS_MAX);
}

#[test]
fn a_name_that_cannot_be_shown_is_refused_in_words() {
    let refused = Hello::new("", 0, &[0; 32], "").unwrap_err();
    assert!(Name::new("").is_err_and(|error| refused == error.to_string()));
    assert!(Hello::new("Ada", 0, &[0; 31], "").unwrap_err().contains("32 bytes"));
}

#[test]
fn a_world_that_is_offered_in_pieces_is_entered_with_its_head() {
    let cut = sightline_visibility::streaming::pieces_of(&voxel_floor::world(&[]), &[]);
    let id = PieceId::of(&cut.head);
    let head = Some(HeadOffer { id: id.0, bytes: cut.head.len() as u32 });
    let offer = |number| ServerMessage::World { number, id: [3; 32], bytes: 9, head };
    let mut client = client();
    client.opened(at(0));
    tell(&mut client, &[welcome(1), offer(1)]);
    assert_eq!(client.wanted().unwrap().path(), format!("pieces/{id}/head"));
    client.give(b"something else");
    assert_eq!(client.stage(), &Stage::Fetching);
    client.give(&cut.head);
    tell(&mut client, &[entered()]);
    assert!(client.is_in() && client.head_id() == Some(id));
    let building = client.building().unwrap();
    assert!(building.complete().is_none() && building.is(&client.world().unwrap()));

    // After a link that broke it is the same world, unless its pieces are offered no more.
    client.closed(at(50), "the cable");
    client.opened(at(60));
    tell(&mut client, &[welcome(1), offer(2)]);
    assert_eq!(client.stage(), &Stage::Entering);
    let (bytes, file) = world(3, &[]);
    tell(&mut client, &[file]);
    assert_eq!(client.wanted(), content_id(&bytes).ok().map(Wanted::File));
    client.give(&bytes);
    tell(&mut client, &[entered()]);
    assert!(client.building().unwrap().complete().is_some() && client.head_id().is_none());
}

#[test]
fn where_a_head_cannot_be_read_the_file_is_fetched() {
    let id = PieceId::of(b"no head");
    let head = Some(HeadOffer { id: id.0, bytes: 7 });
    let (bytes, _) = world(1, &[]);
    let file = content_id(&bytes).unwrap();
    let offer = ServerMessage::World { number: 1, id: file.0, bytes: 9, head };
    let mut client = client();
    client.opened(at(0));
    tell(&mut client, &[welcome(1), offer]);
    client.give(b"no head");
    assert_eq!(client.wanted(), Some(Wanted::File(file)));
    client.give(&bytes);
    tell(&mut client, &[entered()]);
    assert!(client.is_in() && client.building().unwrap().complete().is_some());
}

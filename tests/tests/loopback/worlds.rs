//! A server that has no world yet, and one that replaces its world.

use std::sync::{Arc, Mutex};

use glam::Vec3;
use sightline_client::net::{ConnectOptions, Dialer, JoinProgress, Session};
use sightline_server::net::{Identity, ServeConfig, ServedWorld, Server};
use sightline_world::motion::Pose;

use super::{
    building::{self, WAY, WEST},
    config, hears, holds, join, options, serve, until, walk,
};

/// Gives a server another world, and waits until a visitor is in it.
async fn change(server: &Server, world: ServedWorld, visitors: &[&Session]) {
    let before: Vec<_> = visitors.iter().map(|session| session.world()).collect();
    let changer = server.world_changer();
    let changed = tokio::task::spawn_blocking(move || changer.change(world)).await.unwrap();
    assert_eq!(changed, Ok(()));
    for (session, before) in visitors.iter().zip(&before) {
        until("the visitor is in the other world", || {
            !Arc::ptr_eq(&session.world(), before) && session.is_present()
        })
        .await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn who_comes_before_the_world_waits_for_it() {
    let server = Server::listen(config(), &Identity::generate().unwrap()).unwrap();
    let changer = server.world_changer();
    changer.tell_loading("voxels 30 %");
    let heard = Arc::new(Mutex::new(Vec::new()));
    let told = heard.clone();
    let options = ConnectOptions {
        progress: Some(Arc::new(move |step| told.lock().unwrap().push(step))),
        ..options(&server, "Ada", WEST)
    };
    let address = server.local_addr().unwrap();
    let joining = tokio::spawn(async move { Dialer::new(None).connect(address, &options).await });
    let waits = |what: &str| JoinProgress::Waiting(what.to_owned());
    until("Ada waits", || heard.lock().unwrap().contains(&waits("voxels 30 %"))).await;
    changer.tell_loading("voxels 60 %");
    until("Ada hears more", || heard.lock().unwrap().contains(&waits("voxels 60 %"))).await;
    assert!(!joining.is_finished() && server.stats().counts.live == 0);
    let change = move || changer.change(building::world());
    tokio::task::spawn_blocking(change).await.unwrap().unwrap();
    let ada = joining.await.unwrap().unwrap();
    assert!(ada.pose().eye.distance(WEST) < 0.01);
    let bo = join(&server, "Bo", WEST + Vec3::X).await;
    until("they see each other", || holds(&ada, bo.avatar()) && holds(&bo, ada.avatar())).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn visitors_are_moved_over_and_keep_their_places_connections_and_names() {
    let (server, _) = serve(ServeConfig { free_entry: false, ..config() });
    let (ada, bo) = (join(&server, "Ada", WEST).await, join(&server, "Bo", WEST).await);
    walk(&ada, WAY[1]).await;
    let (ids, before) = ([ada.avatar(), bo.avatar()], ada.stats());
    for world in [building::coarse_world(), building::world()] {
        ada.set_pose(Pose { yaw: 1.0, ..ada.pose() });
        change(&server, world, &[&ada, &bo]).await;
        assert!(ada.pose().eye.distance(WAY[1]) < 0.3, "{}", ada.pose().eye);
        assert!((ada.pose().yaw - 1.0).abs() < 0.01, "it looks where it looked");
        assert_eq!([ada.avatar(), bo.avatar()], ids);
        walk(&ada, WAY[1]).await;
        walk(&bo, WEST + Vec3::X).await;
        until("they see each other", || holds(&ada, bo.avatar()) && holds(&bo, ada.avatar())).await;
        let shown = || bo.shown_avatars().iter().any(|ada| ada.pose.eye.distance(WAY[1]) < 0.3);
        until("Bo knows where Ada is", shown).await;
        ada.chat("hello").unwrap();
        hears(&bo, "Ada", "hello").await;
    }
    assert_eq!(server.stats().clients.len(), 2);
    let after = ada.stats();
    assert!(after.messages_out > before.messages_out && after.reporting.ticks > 0);
    assert_eq!((ada.end(), bo.end()), (None, None));
}

#[tokio::test(flavor = "multi_thread")]
async fn who_has_no_room_any_more_begins_at_a_spawn_point() {
    let (server, _) = serve(ServeConfig { free_entry: false, ..config() });
    let ada = join(&server, "Ada", WEST).await;
    change(&server, building::crammed_world(), &[&ada]).await;
    assert!(ada.pose().eye.distance(WAY[1]) < 0.01, "{}", ada.pose().eye);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_newer_world_takes_the_place_of_one_that_is_being_entered() {
    let (server, _) = serve(config());
    let ada = join(&server, "Ada", WEST).await;
    let changer = server.world_changer();
    let worlds = [building::coarse_world(), building::world(), building::coarse_world()];
    let last = worlds[2].clone();
    let change_all = move || worlds.into_iter().for_each(|world| changer.change(world).unwrap());
    tokio::task::spawn_blocking(change_all).await.unwrap();
    until("Ada is in the last one", || *ada.world() == **last.world() && ada.is_present()).await;
    let bo = join(&server, "Bo", WEST + Vec3::X).await;
    until("they see each other", || holds(&ada, bo.avatar()) && holds(&bo, ada.avatar())).await;
    assert_eq!(ada.end(), None);
}

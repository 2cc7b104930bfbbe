//! A server that compiles the building that it serves.

use std::{
    fs,
    path::Path,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    thread::JoinHandle,
};

use sightline_client::net::{ConnectOptions, Dialer, Session};
use sightline_compiler::{CompileOptions, Quality};
use sightline_server::{
    building_cache::BuildingCache,
    building_files::{BuildingFiles, BuildingSource},
    net::{Identity, ServeConfig, Server},
    supply::{Preparation, Supplied, Supply, SupplyError, SupplyNews},
};

use super::{config, hears, holds, options, until};

/// A server and its supply.
struct Supplier {
    server: Server,
    /// What was told, without progress.
    news: Arc<Mutex<Vec<String>>>,
    ends: Arc<AtomicBool>,
    supply: JoinHandle<Result<(), SupplyError>>,
}

impl Supplier {
    /// Serves `house.glb` of a folder.
    fn start(folder: &Path, watches: bool) -> Self {
        let config = ServeConfig { free_entry: false, ..config() };
        let server = Server::listen(config, &Identity::generate().unwrap()).unwrap();
        let (news, ends) = (Arc::new(Mutex::new(Vec::new())), Arc::new(AtomicBool::new(false)));
        let (heard, ended, changer) = (news.clone(), ends.clone(), server.world_changer());
        // All begin at one place, and see each other there.
        let mut files = BuildingFiles::of(&folder.join("house.glb"));
        files.spawns = files.read().map_or(Vec::new(), |model| model.spawns[..1].to_vec());
        let supplied = Supplied::Building {
            source: BuildingSource::Files(files),
            options: CompileOptions { cell: Some(4.0), ..CompileOptions::default() },
            cache: BuildingCache::new(&folder.join("cache")),
        };
        let supply = std::thread::spawn(move || {
            let tell = &|news: SupplyNews<'_>| match news {
                SupplyNews::Progress(..) => {}
                SupplyNews::Serves { how, .. } => heard.lock().unwrap().push(format!("{how:?}")),
                SupplyNews::Failed(error) => heard.lock().unwrap().push(format!("failed: {error}")),
                news => heard.lock().unwrap().push(format!("{news:?}")),
            };
            Supply { supplied, watches, changer, ends: &ended, tell }.run()
        });
        Self { server, news, ends, supply }
    }

    async fn join(&self, name: &str) -> Session {
        let options =
            ConnectOptions { place: None, ..options(&self.server, name, glam::Vec3::ZERO) };
        let address = self.server.local_addr().unwrap();
        Dialer::new(None).connect(address, &options).await.unwrap()
    }

    /// Waits until this was told, after all that was waited for before.
    async fn tells(&self, begins: &str) -> String {
        let mut told = None;
        until(&format!("{begins} is told"), || {
            let mut news = self.news.lock().unwrap();
            let at = news.iter().position(|line| line.starts_with(begins));
            told = at.and_then(|at| news.drain(..=at).next_back());
            told.is_some()
        })
        .await;
        told.unwrap()
    }

    fn end(self) -> Result<(), SupplyError> {
        self.ends.store(true, Relaxed);
        self.supply.join().unwrap()
    }
}

fn served(how: Preparation) -> String {
    format!("{how:?}")
}

fn write_house(folder: &Path, rooms: usize) {
    fs::write(folder.join("house.glb"), sightline_demo_building::glb(rooms, 1)).unwrap();
}

/// Whether a visitor is in a finely compiled world: its voxels are those of small models.
fn is_fine(session: &Session) -> bool {
    session.world().octree.voxel() == 1.0 / 32.0 && session.is_present()
}

/// Waits until both are in a world of the server and each is told of the other.
async fn are_together(ada: &Session, bo: &Session) {
    let each_other = || holds(ada, bo.avatar()) && holds(bo, ada.avatar());
    until("they see each other", each_other).await;
    ada.chat("hello").unwrap();
    hears(bo, "Ada", "hello").await;
    assert_eq!((ada.end(), bo.end()), (None, None));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_model_is_served_quickly_then_finely_and_the_second_start_compiles_nothing() {
    let folder = tempfile::tempdir().unwrap();
    write_house(folder.path(), 2);
    let supplier = Supplier::start(folder.path(), false);
    let (ada, bo) = (supplier.join("Ada").await, supplier.join("Bo").await);
    let [quick, fine] = [Quality::Quick, Quality::Fine];
    supplier.tells(&served(Preparation::Compiled(quick))).await;
    supplier.tells(&served(Preparation::Compiled(fine))).await;
    until("both are in the fine world", || is_fine(&ada) && is_fine(&bo)).await;
    are_together(&ada, &bo).await;
    assert!(supplier.end().is_ok());

    let supplier = Supplier::start(folder.path(), false);
    let ada = supplier.join("Ada").await;
    supplier.tells(&served(Preparation::Kept(fine))).await;
    assert!(is_fine(&ada));
    assert!(supplier.end().is_ok());
    let kept = fs::read_dir(folder.path().join("cache")).unwrap().count();
    assert_eq!(kept, 1, "the quick world is not kept beside the fine one");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_watched_file_changes_breaks_and_is_mended() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("house.glb");
    write_house(folder.path(), 2);
    let supplier = Supplier::start(folder.path(), true);
    let ada = supplier.join("Ada").await;
    let fine = served(Preparation::Compiled(Quality::Fine));
    supplier.tells(&fine).await;
    let before = ada.world().mesh.triangles.len();

    write_house(folder.path(), 3);
    supplier.tells("Changed").await;
    supplier.tells(&fine).await;
    let has_grown = || ada.world().mesh.triangles.len() > before && ada.is_present();
    until("Ada is in the larger house", has_grown).await;

    let good = fs::read(&path).unwrap();
    fs::write(&path, b"glTF, but broken").unwrap();
    let failed = supplier.tells("failed: ").await;
    assert!(failed.contains("house.glb: "), "{failed}");
    let bo = supplier.join("Bo").await;
    until("the world before is served on", has_grown).await;
    assert_eq!(bo.world().mesh.triangles.len(), ada.world().mesh.triangles.len());

    // The content that is served already needs nothing; another one does.
    fs::write(&path, &good).unwrap();
    supplier.tells("Changed").await;
    write_house(folder.path(), 2);
    supplier.tells(&served(Preparation::Kept(Quality::Fine))).await;
    let is_back = || ada.world().mesh.triangles.len() == before && ada.is_present();
    until("Ada is in the first house", is_back).await;
    until("Bo is too", || bo.world().mesh.triangles.len() == before && bo.is_present()).await;
    are_together(&ada, &bo).await;
    let news = std::mem::take(&mut *supplier.news.lock().unwrap());
    assert!(!news.iter().any(|line| line.starts_with("failed")), "told once: {news:?}");
    assert!(supplier.end().is_ok());
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_first_world_the_supply_fails() {
    let folder = tempfile::tempdir().unwrap();
    let supplier = Supplier::start(folder.path(), true);
    let error = supplier.supply.join().unwrap().unwrap_err().to_string();
    assert!(error.contains("cannot read") && error.contains("house.glb"), "{error}");
}

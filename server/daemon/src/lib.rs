//! The server: a thin shell around the engine that speaks QUIC.
//!
//! * [`building_files`]: what a building is compiled from, and [`building_cache`]: compiled
//!   buildings, kept for the next run.
//! * [`supply`]: compiles the building of a running server, and compiles it again when it changes.
//! * [`net`]: the endpoint, admission and sessions. It is the only module that knows QUIC. Start
//!   with [`net::Server`]: it binds an address and serves a [`net::ServedWorld`].
//! * [`bus`]: the way to other servers of the same building, over NATS.
//! * [`people`]: whom the server remembers: keys, roles, bans, places.
//! * [`operate`]: what an operator sees of a running server: [`operate::ServerStats`] and
//!   [`operate::Overview`].
//! * `http`, a feature that is on unless it is turned off: a listener for operators, with metrics
//!   and a live page.
//! * `web`, another one: a listener for visitors with a browser.
//!
//! The engine decides everything that a client is told; nothing here does. The binary
//! `sightline-server` adds the commands.
//!
//! # Example
//!
//! Serve a small building from a program of your own:
//!
//! ```
//! use sightline_compiler::CompileOptions;
//! use sightline_server::{
//!     building_cache::BuildingCache,
//!     building_files::BuildingSource,
//!     net::{Identity, ServeConfig, Server},
//! };
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let data = folder.path();
//! // An office of four rooms, with coarse voxels and cells. Any GLB file will do.
//! let (bytes, title) = (sightline_demo_building::glb(4, 1), "office".to_owned());
//! let office = BuildingSource::Glb { bytes, title };
//! let options = CompileOptions { voxel: Some(0.5), cell: Some(4.0), ..Default::default() };
//! let cache = BuildingCache::new(&data.join("buildings"));
//! let building = cache.load_or_compile(&office, &options, &|_, _| ())?;
//!
//! // Clients recognise the server by its identity, which the folder keeps.
//! let identity = Identity::keep(data)?;
//! let config = ServeConfig { listen: "127.0.0.1:0".parse()?, ..Default::default() };
//! tokio::runtime::Runtime::new()?.block_on(async {
//!     let mut server = Server::bind(building.world, config, &identity)?;
//!     println!("sightline-client walk {}", server.local_addr()?);
//!     assert_eq!(server.stats().counts.live, 0);
//!     server.shutdown().await;
//!     Ok(())
//! })
//! # }
//! ```

mod address;
mod background;
pub mod building_cache;
pub mod building_files;
#[cfg_attr(not(feature = "bus"), allow(dead_code, reason = "only NATS carries what stations say"))]
pub mod bus;
#[cfg(feature = "http")]
pub mod http;
mod kept_files;
pub mod net;
#[cfg_attr(
    not(feature = "web"),
    allow(dead_code, reason = "only the listeners read and count all")
)]
pub mod operate;
pub mod people;
pub mod supply;
#[cfg(feature = "web")]
pub mod web;

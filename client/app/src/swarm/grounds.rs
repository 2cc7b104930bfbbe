//! What a swarm knows of the building that it walks in.

use std::sync::Arc;

use sightline_client_core::navigation::Navigation;
use sightline_world::World;
use tokio::task::JoinHandle;

use super::{SwarmError, sight::Sight};

/// A building, the ways in it, and who is in whose sight there.
pub struct Grounds {
    pub world: Arc<World>,
    /// Empty where visitors follow recorded walks.
    pub navigation: Navigation,
    pub sight: Sight,
}

impl Grounds {
    /// Finds the ways in a building, unless they are not needed.
    pub async fn find(world: Arc<World>, needs_ways: bool) -> Result<Arc<Self>, SwarmError> {
        let find = move || {
            let navigation =
                if needs_ways { Navigation::new(&world) } else { Navigation::default() };
            let sight = Sight::new(world.clone());
            Self { world, navigation, sight }
        };
        match tokio::task::spawn_blocking(find).await {
            Ok(grounds) if !needs_ways || !grounds.navigation.is_empty() => Ok(Arc::new(grounds)),
            _ => Err(SwarmError::NoFloor),
        }
    }

    /// Whether this is the building with the given world.
    pub fn are_of(&self, world: &Arc<World>) -> bool {
        Arc::ptr_eq(&self.world, world)
    }
}

/// Finds the grounds of the next building, while visitors stand in it.
#[derive(Default)]
pub struct Renewal(Option<JoinHandle<Result<Arc<Grounds>, SwarmError>>>);

impl Renewal {
    /// The grounds of a building if they are found. Otherwise the search is on, or begins.
    pub async fn of(
        &mut self,
        world: &Arc<World>,
        needs_ways: bool,
    ) -> Result<Option<Arc<Grounds>>, SwarmError> {
        match self.0.take_if(|search| search.is_finished()) {
            Some(search) => {
                let found = search.await.unwrap_or(Err(SwarmError::NoFloor))?;
                Ok(Some(found).filter(|grounds| grounds.are_of(world)))
            }
            None => {
                self.0
                    .get_or_insert_with(|| tokio::spawn(Grounds::find(world.clone(), needs_ways)));
                Ok(None)
            }
        }
    }
}

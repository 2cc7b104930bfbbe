//! Plans of the world that is served, one for each storey.

use std::sync::Arc;

use serde::Serialize;
use sightline_compiler::plan::by_storey;
use sightline_world::World;
use tokio::{sync::Mutex, task::spawn_blocking};

use crate::{background, net::Observer};

/// The plans of one world.
pub(super) struct Plans {
    /// The number of the world.
    pub(super) world: u32,
    pub(super) storeys: Vec<Storey>,
    /// The pictures of the storeys, as PNG.
    pub(super) pictures: Vec<Vec<u8>>,
}

/// A storey, and where places are on its picture.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Storey {
    /// The size of the picture in pixels.
    width: u32,
    height: u32,
    /// Eyes at these heights are on this storey, in metres; no bound is `None`.
    eyes: [Option<f32>; 2],
    /// The height at which the storey is cut, in metres.
    cut: f32,
    /// The x and z of the upper left corner, in metres.
    corner: [f32; 2],
    /// The scale: pixels per metre.
    px_per_m: f32,
}

/// Draws plans when they are first asked for, and keeps those of one world.
pub(super) struct PlanDrawer {
    observer: Observer,
    kept: Mutex<Option<Arc<Plans>>>,
}

impl PlanDrawer {
    pub(super) fn new(observer: Observer) -> Self {
        Self { observer, kept: Mutex::default() }
    }

    /// The plans of the world at present. `None` before the first world. All who ask meanwhile wait
    /// for the same plans.
    pub(super) async fn plans(&self) -> Option<Arc<Plans>> {
        let (number, world) = self.observer.world()?;
        let mut kept = self.kept.lock().await;
        if let Some(plans) = kept.as_ref().filter(|plans| plans.world == number) {
            return Some(plans.clone());
        }
        let drawn = spawn_blocking(move || draw(number, &world)).await.ok()?;
        let plans = Arc::new(drawn.inspect_err(|error| tracing::warn!("no plans: {error}")).ok()?);
        *kept = Some(plans.clone());
        Some(plans)
    }
}

/// Draws on one thread of a lower priority, so that the engine and the network go on.
fn draw(number: u32, world: &World) -> anyhow::Result<Plans> {
    let thread = background::threads(1)?;
    let plans = thread.install(|| by_storey(world));
    let eye = |feet: f32| Some(feet + world.body.below_eye).filter(|eye| eye.is_finite());
    let storeys = plans.iter().map(|plan| Storey {
        width: plan.picture.width(),
        height: plan.picture.height(),
        eyes: [eye(plan.feet.start), eye(plan.feet.end)],
        cut: plan.cut,
        corner: plan.corner,
        px_per_m: plan.px_per_m,
    });
    let storeys = storeys.collect();
    let pictures: Result<_, _> = plans.iter().map(|plan| plan.picture.to_png()).collect();
    Ok(Plans { world: number, storeys, pictures: pictures? })
}

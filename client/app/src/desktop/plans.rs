//! The plan of the storey that one is on, made beside the window.

use std::{
    sync::{
        Arc,
        mpsc::{Receiver, TryRecvError, channel},
    },
    thread,
};

use sightline_renderer::plan::Plan;
use sightline_world::World;

/// The plan of the storey that one is on, made by a thread when it is first asked for.
#[derive(Default)]
pub(super) struct Plans {
    newest: Option<Arc<Plan>>,
    making: Option<Receiver<Plan>>,
}

impl Plans {
    /// The plan of the storey of a body with its soles at this height. Until it is made, the one
    /// before, if any.
    pub(super) fn at(&mut self, world: &Arc<World>, soles: f32) -> Option<Arc<Plan>> {
        match self.making.as_ref().map(Receiver::try_recv) {
            Some(Ok(plan)) => (self.newest, self.making) = (Some(Arc::new(plan)), None),
            Some(Err(TryRecvError::Disconnected)) => self.making = None,
            Some(Err(TryRecvError::Empty)) | None => {}
        }
        let serves = |plan: &Arc<Plan>| plan.serves(soles);
        if self.making.is_none() && !self.newest.as_ref().is_some_and(serves) {
            let ((sender, receiver), world) = (channel(), world.clone());
            // Nobody waits for a plan that cannot be sent.
            thread::spawn(move || sender.send(Plan::new(&world, soles)));
            self.making = Some(receiver);
        }
        self.newest.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_is_made_beside_and_anew_on_another_storey() {
        let world = Arc::new(sightline_fixtures::voxel_floor::world(&[]));
        let mut plans = Plans::default();
        let mut serves = |soles: f32| {
            while plans.at(&world, soles).is_none_or(|plan| !plan.serves(soles)) {
                thread::yield_now();
            }
            plans.at(&world, soles + 0.5).unwrap()
        };
        let [low, high] = [serves(0.125), serves(3.0)];
        assert!(low.serves(0.125) && !low.serves(3.0) && high.serves(3.0));
    }
}

//! The plan of the storey that one is on, made beside the window.

use std::{
    sync::{
        Arc,
        mpsc::{Receiver, TryRecvError, channel},
    },
    thread,
};

use sightline_client_core::arriving::ArrivingWorld;
use sightline_world::plan::Plan;

/// The plan of the storey that one is on: a piece of a world that arrives. Of a whole world it is
/// made by a thread when it is first asked for.
#[derive(Default)]
pub(super) struct Plans {
    newest: Option<Arc<Plan>>,
    making: Option<Receiver<Plan>>,
}

impl Plans {
    /// The plan of the storey of a body with its soles at this height, in metres. Until it is here,
    /// the one before, if any.
    pub(super) fn at(&mut self, building: &ArrivingWorld, soles: f32) -> Option<Arc<Plan>> {
        if let Some(plan) = building.plan_at(soles) {
            self.newest = Some(plan.clone());
        }
        match self.making.as_ref().map(Receiver::try_recv) {
            Some(Ok(plan)) => (self.newest, self.making) = (Some(Arc::new(plan)), None),
            Some(Err(TryRecvError::Disconnected)) => self.making = None,
            Some(Err(TryRecvError::Empty)) | None => {}
        }
        let serves = |plan: &Arc<Plan>| plan.serves(soles);
        if self.making.is_none()
            && !self.newest.as_ref().is_some_and(serves)
            && let Some(world) = building.complete().cloned()
        {
            let (sender, receiver) = channel();
            // Nobody waits for a plan that cannot be sent.
            thread::spawn(move || sender.send(Plan::new(&world, soles)));
            self.making = Some(receiver);
        }
        self.newest.clone()
    }
}

#[cfg(test)]
mod tests {
    use sightline_visibility::streaming::pieces_of;
    use sightline_world::WorldHead;

    use super::*;

    #[test]
    fn a_plan_is_made_beside_and_anew_on_another_storey() {
        let world = sightline_fixtures::voxel_floor::world(&[]);
        let world = ArrivingWorld::whole(Arc::new(world));
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

    #[test]
    fn of_a_world_that_arrives_the_plan_is_a_piece() {
        let world = sightline_fixtures::voxel_floor::world(&[]);
        let cut = pieces_of(&world, &[0.125]);
        let head = WorldHead::read(&cut.head).unwrap();
        let number = head.plan_at(0.125).unwrap();
        let mut building = ArrivingWorld::from_head(head);
        let mut plans = Plans::default();
        assert!(plans.at(&building, 0.125).is_none());
        building.take(number, cut.pieces[number].clone()).unwrap();
        assert_eq!(plans.at(&building, 0.125).as_deref(), Some(&Plan::new(&world, 0.125)));
        assert!(plans.at(&building, 9.0).is_some(), "the one before");
    }
}

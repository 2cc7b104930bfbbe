//! A host around the engine, without a network. Ada and Ben are in two rooms with a wall between
//! them, and fall silent. Then Ben comes through the door. The example prints what each client is
//! told, and fails if that is not as it should be.

mod visitor;

use std::{collections::BTreeMap, sync::Arc, time::Duration};

use glam::Vec3;
use sightline_engine::{Config, Engine, Input, Output, Reason};
use sightline_fixtures::two_rooms;
use sightline_world::motion::AvatarId;

use visitor::Visitor;

const ADA: AvatarId = AvatarId(1);
const BEN: AvatarId = AvatarId(2);
const TICK: Duration = Duration::from_millis(50);

/// The engine, its clock and its clients.
struct Host {
    engine: Engine,
    now: Duration,
    /// The clients that are in.
    visitors: BTreeMap<AvatarId, Visitor>,
}

impl Host {
    fn join(&mut self, avatar: AvatarId, name: &str, eye: Vec3) {
        let join =
            Input::Join { avatar, name: name.to_owned(), colour: [255; 3], place: Some(eye) };
        self.engine.handle(self.now, join);
        // No message takes any time here. A host with a network measures round trips all the time.
        let round_trip = Duration::ZERO;
        self.engine.handle(self.now, Input::RoundTrip { avatar, round_trip });
    }

    /// Takes in reports, lets the engine decide, and tells the clients.
    fn tick(&mut self) {
        for (&avatar, visitor) in &mut self.visitors {
            if let Some(report) = visitor.report(self.now, TICK, &self.engine.agility()) {
                self.engine.handle(self.now, Input::Report { avatar, report });
            }
        }
        let mut outputs = Vec::new();
        self.engine.tick(self.now, &mut outputs);
        for output in outputs {
            if let Some(words) = words(&output) {
                let to = if output.to() == ADA { "Ada" } else { "Ben" };
                println!("{:5.2} s, to {to}: {words}", self.now.as_secs_f32());
            }
            self.visitors.entry(output.to()).or_default().hear(self.now, output);
        }
        self.now += TICK;
    }

    /// Whether the line between the two goes through the door rather than the wall.
    fn has_line_of_sight(&self) -> bool {
        let [ada, ben] = [ADA, BEN].map(|id| self.visitors[&id].pose.eye);
        ben.x < 6.0 || ada.lerp(ben, (6.0 - ada.x) / (ben.x - ada.x)).z < 1.0
    }
}

/// An output in words. Poses have none.
fn words(output: &Output) -> Option<String> {
    Some(match output {
        Output::Entered { pose, .. } => format!("you are in, at {:.1}", pose.eye),
        Output::Appear { name, pose, .. } => {
            format!("{name} may come into view, from {:.1}", pose.eye)
        }
        Output::Vanish { .. } => "the other cannot be seen any more".to_owned(),
        Output::Live { tolerance, .. } => {
            format!("say where you are when you are {:.2} m off your course", tolerance.metres)
        }
        Output::Quiet { tbv, .. } => {
            let (Vec3 { x, z, .. }, to) = (tbv.within.min, tbv.within.max);
            let place = format!("x is in {x:.1} to {:.1} and z in {z:.1} to {:.1}", to.x, to.z);
            format!("be silent while {place}, until {:.1} s", tbv.expiry.as_secs_f32())
        }
        Output::Ask { .. } => "say once where you are".to_owned(),
        _ => return None,
    })
}

fn main() {
    // A real host reads its world from the file that `sightline-server compile` makes, by
    // `World::read`.
    let engine =
        Engine::new(Arc::new(two_rooms::world()), Config { tick: TICK, ..Config::default() });
    let mut host = Host { engine, now: Duration::ZERO, visitors: BTreeMap::new() };
    host.join(ADA, "Ada", Vec3::new(3.0, 1.6, 5.0));
    host.join(BEN, "Ben", Vec3::new(9.0, 1.6, 5.0));

    // Both stand still behind their wall. In ten seconds each is asked once, when its TBV expires.
    (0..200).for_each(|_| host.tick());
    assert!(host.visitors.values().all(|v| v.tbv.is_some() && v.sees.is_empty()));
    assert_eq!((host.engine.stats().expiries, host.engine.stats().reports), (2, 2));

    // Ben goes to the door and through it. Each is told of the other before they see each other.
    // He reports only where he turns, or stops.
    let before = host.engine.stats().reports;
    for way in [Vec3::new(7.0, 1.6, 0.5), Vec3::new(3.0, 1.6, 0.5)] {
        while host.visitors[&BEN].pose.eye != way {
            host.visitors.get_mut(&BEN).unwrap().walk(way, TICK);
            host.tick();
            let is_told =
                [(ADA, BEN), (BEN, ADA)].map(|(to, of)| host.visitors[&to].sees.contains_key(&of));
            assert!(is_told == [true; 2] || !host.has_line_of_sight(), "at {:?}", host.now);
        }
    }
    assert!(host.has_line_of_sight());
    let shown = host.visitors[&ADA].shows(BEN, host.now - TICK);
    assert!(shown.distance(host.visitors[&BEN].pose.eye) < 0.2, "{shown}");
    let reports = host.engine.stats().reports - before;
    println!("\nBoth together reported {reports} times on Ben's way.");
    assert!(reports < 40, "{reports} reports in five seconds");
    assert_eq!(host.engine.stats().refusals, 0);

    let explanation = host.engine.explain(ADA, BEN).expect("both are there");
    assert!(matches!(explanation.reason, Reason::Free(_)));
    println!("\nAda is told of Ben:\n{explanation}");
}

#[test]
fn the_example_runs_without_failing() {
    main();
}

//! Two stations on a bus that takes no time, and neighbours that lie.

use sightline_world::motion::AvatarId;

use super::stage::{self, Stage};
use crate::{
    Config, Input, StationId, StationMessage, StationOutput, StationWord,
    bus::{HeardOf, Heartbeat},
};

const ONE: StationId = StationId(1);
const TWO: StationId = StationId(2);

/// Two stations of a row of five rooms.
struct Bus {
    stages: [Stage; 2],
    /// What has been said, and to whom.
    said: Vec<StationWord>,
    /// Whether what is said is lost.
    is_broken: bool,
}

impl Bus {
    fn new() -> Self {
        let stage = |name: StationId| {
            let mut stage = Stage::new(stage::row(5), Config::default());
            stage.engine = stage.engine.as_station(name);
            stage
        };
        Self { stages: [ONE, TWO].map(stage), said: Vec::new(), is_broken: false }
    }

    fn ticks(&mut self, count: usize) {
        for _ in 0..count {
            self.stages.iter_mut().for_each(Stage::tick);
            self.exchange();
        }
    }

    /// Delivers until nothing more is said.
    fn exchange(&mut self) {
        loop {
            let said = [0, 1].map(|k| self.stages[k].engine.take_station_outputs());
            if said.iter().all(Vec::is_empty) {
                return;
            }
            for (from, outputs) in said.into_iter().enumerate() {
                for StationOutput { message, .. } in outputs {
                    self.said.push(message.word.clone());
                    if !self.is_broken {
                        self.tell(from, &message);
                    }
                }
            }
        }
    }

    fn tell(&mut self, from: usize, message: &StationMessage) {
        let Stage { engine, now, .. } = &mut self.stages[1 - from];
        engine.handle_station(*now, [ONE, TWO][from], message);
    }

    fn said(&mut self, kind: &str) -> usize {
        let said = std::mem::take(&mut self.said);
        said.iter().filter(|word| word.kind() == kind).count()
    }
}

#[test]
fn neighbours_see_and_hear_each_other_and_learn_nothing_of_those_far_away() {
    let mut bus = Bus::new();
    let [one, two] = &mut bus.stages;
    let (ada, ben, far) = (one.join(1, 5.0), two.join(2, 8.0), two.join(3, 45.0));
    bus.ticks(20);
    let [one, two] = &mut bus.stages;
    assert!(one.client(ada).sees.contains_key(&ben) && two.client(ben).sees.contains_key(&ada));
    assert!(one.engine.guests().eq([(ben, true)]), "three rooms away nobody is known");
    assert!(two.engine.guests().eq([(ada, true)]) && two.engine.avatars().eq([ben, far]));
    two.engine.handle(two.now, Input::Chat { avatar: ben, text: "good day".to_owned() });
    bus.ticks(2);
    assert_eq!(bus.stages[0].client(ada).heard, ["good day"]);
    // What its own station alone may say is ignored.
    let [one, _] = &mut bus.stages;
    one.engine.handle(one.now, Input::Leave { avatar: ben });
    bus.ticks(1);
    assert!(bus.stages[0].client(ada).sees.contains_key(&ben));
    bus.stages[1].leave(ben);
    bus.ticks(2);
    assert!(bus.stages[0].client(ada).sees.is_empty());
}

#[test]
fn two_that_are_hidden_from_each_other_cost_no_message() {
    let mut bus = Bus::new();
    let (ada, ben) = (bus.stages[0].join(1, 5.0), bus.stages[1].join(2, 35.0));
    bus.ticks(60);
    assert!(bus.stages[0].client(ada).quiet.is_some() && bus.stages[1].client(ben).quiet.is_some());
    bus.said("");
    bus.ticks(60);
    let said: Vec<&StationWord> =
        bus.said.iter().filter(|word| word.kind() != "heartbeat").collect();
    assert!(said.is_empty(), "{said:?}");
}

#[test]
fn what_was_lost_is_made_good_and_no_ghost_remains() {
    let mut bus = Bus::new();
    let (ada, ben) = (bus.stages[0].join(1, 5.0), bus.stages[1].join(2, 8.0));
    bus.ticks(20);
    bus.is_broken = true;
    bus.stages[1].leave(ben);
    let cleo = bus.stages[1].join(3, 7.0);
    bus.ticks(10);
    bus.is_broken = false;
    bus.ticks(30);
    assert!(bus.stages[0].client(ada).sees.keys().eq([&cleo]), "the loss is found");
    bus.is_broken = true;
    bus.ticks(60);
    assert!(bus.stages[0].client(ada).sees.is_empty(), "who is not heard for long is gone");
    bus.is_broken = false;
    bus.ticks(30);
    assert!(bus.stages[0].client(ada).sees.keys().eq([&cleo]));
    assert!(bus.stages[1].client(cleo).sees.keys().eq([&ada]));
}

#[test]
fn a_neighbour_that_lies_or_floods_is_cut_off_without_harm_to_others() {
    let words: [fn(&StationWord) -> StationWord; 4] = [
        |_| StationWord::Subscribe { number: 9, added: vec![u32::MAX], removed: vec![] },
        |_| StationWord::Leave { avatar: AvatarId(1) },
        |_| StationWord::Chat { avatar: AvatarId(77), text: "hush".to_owned() },
        |word| {
            let StationWord::Report { avatar, report } = word else { unreachable!("a report") };
            let mut report = *report;
            report.pose.eye.y = f32::NAN;
            StationWord::Report { avatar: *avatar, report }
        },
    ];
    for lie in words {
        let mut bus = Bus::new();
        let (ada, ben) = (bus.stages[0].join(1, 5.0), bus.stages[1].join(2, 8.0));
        let eve = bus.stages[0].join(4, 6.0);
        bus.ticks(20);
        // The next report is replaced by a lie.
        bus.stages[1].walk(ben, 9.0);
        let mut outputs = bus.stages[1].engine.take_station_outputs();
        let is_report = |output: &&mut StationOutput| output.message.word.kind() == "report";
        let output = outputs.iter_mut().find(is_report).expect("it has moved");
        output.message.word = lie(&output.message.word);
        for output in &outputs {
            bus.tell(1, &output.message);
        }
        bus.stages[0].ticks(2);
        let one = &bus.stages[0];
        assert!(one.engine.cut_stations().eq([TWO]) && one.engine.guests().count() == 0);
        assert!(one.client(ada).sees.keys().eq([&eve]), "her own are still there");
    }
    let mut bus = Bus::new();
    bus.ticks(20);
    let heartbeat = Heartbeat {
        slowest: Default::default(),
        silent: Default::default(),
        heard: Vec::<HeardOf>::new(),
    };
    let word = StationWord::Heartbeat(heartbeat);
    let sent = bus.stages[1].now;
    let message = StationMessage { epoch: 1, known: 0, number: 0, sent, word };
    (0..5_000).for_each(|_| bus.tell(1, &message));
    assert!(bus.stages[0].engine.cut_stations().eq([TWO]));
}

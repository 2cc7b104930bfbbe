//! Stations: several engines that share a building.
//!
//! To another station, a station is what the clients of its avatars are to a server. It says where
//! an avatar is and when it departs from its course, and the other station says how exactly it
//! wants to know that, or in which box it wants no word at all. So each station decides for its own
//! viewers alone, by the rules that hold for one server, with [links](link) that take longer.
//!
//! A station hears only of avatars that may be in a sector that it [subscribes](subscription) to.
//! What it has told others of its own is in the [relays](relay) of each avatar.

mod link;
mod relay;
mod subscription;

use std::{
    collections::{BTreeMap, BTreeSet},
    time::Duration,
};

use crate::{
    bit_set::BitSet,
    bus::{Heartbeat, StationId, StationMessage, StationOutput, StationWord, Stay},
    config::Margin,
    timing::Abroad,
};

pub(crate) use link::{Link, Receipt};
pub(crate) use relay::{Guest, Relay, RelayKey, RelayOrder};
pub(crate) use subscription::Subscription;

/// The time between two heartbeats.
const HEARTBEAT: Duration = Duration::from_millis(250);
/// The epoch of a heartbeat that greets all, and is of no link.
const GREETING: u32 = 0;
/// A neighbour that is silent for so long is gone.
const GONE_AFTER: Duration = Duration::from_secs(2);

/// The neighbours of a station, and what they are told.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stations {
    /// The name of this station; `None` for a server without neighbours.
    own: Option<StationId>,
    epochs: u32,
    links: BTreeMap<StationId, Link>,
    /// Neighbours that have lied or flooded.
    cut: BTreeSet<StationId>,
    pub(crate) subscription: Subscription,
    /// Whether all must be told the whole subscription, since what some of them said is void.
    owes_whole: bool,
    outputs: Vec<StationOutput>,
    next_beat: Duration,
}

impl Stations {
    pub(crate) fn new(own: StationId) -> Self {
        Self { own: Some(own), ..Self::default() }
    }

    /// Begins links with numbers above this one, which no link of an engine before had.
    pub(crate) fn count_from(&mut self, epochs: u32) {
        self.epochs = self.epochs.max(epochs);
    }

    /// Whether there is another station.
    pub(crate) fn are_several(&self) -> bool {
        !self.links.is_empty()
    }

    pub(crate) fn is_station(&self) -> bool {
        self.own.is_some()
    }

    /// The neighbours that take in what they are told, by name.
    pub(crate) fn ready(&self) -> impl Iterator<Item = (StationId, &Link)> {
        self.links.iter().filter(|(_, link)| link.is_ready).map(|(id, link)| (*id, link))
    }

    pub(crate) fn link(&self, station: StationId) -> Option<&Link> {
        self.links.get(&station)
    }

    pub(crate) fn link_mut(&mut self, station: StationId) -> Option<&mut Link> {
        self.links.get_mut(&station)
    }

    /// How many avatars of others are known.
    pub(crate) fn guests(&self) -> usize {
        self.links.values().map(|link| link.guests.len()).sum()
    }

    /// The stations that were cut off.
    pub(crate) fn cut(&self) -> impl Iterator<Item = StationId> + '_ {
        self.cut.iter().copied()
    }

    /// Takes in that a message has come.
    pub(crate) fn receive(
        &mut self,
        now: Duration,
        from: StationId,
        margin: Margin,
        message: &StationMessage,
    ) -> Receipt {
        let Some(own) = self.own.filter(|own| *own != from && !self.cut.contains(&from)) else {
            return Receipt::Stale;
        };
        let is_beat = matches!(message.word, StationWord::Heartbeat(_));
        if is_beat && !self.links.contains_key(&from) {
            self.begin(now, from, margin);
        }
        let Some(link) = self.links.get_mut(&from) else { return Receipt::Stale };
        if is_beat && message.epoch == GREETING {
            return Receipt::Stale;
        }
        let receipt = link.receive(now, own, margin, message);
        match receipt {
            Receipt::Void => self.next_beat = now,
            Receipt::Lost => self.begin(now, from, margin),
            Receipt::Stale | Receipt::Good | Receipt::Flood => {}
        }
        receipt
    }

    /// Begins a link, or begins it anew.
    fn begin(&mut self, now: Duration, station: StationId, margin: Margin) {
        self.epochs += 1;
        self.links.insert(station, Link::new(self.epochs, now, margin));
        self.next_beat = now;
    }

    /// Takes in that what a neighbour said is void.
    pub(crate) fn owe_whole(&mut self) {
        self.subscription.doubt();
        self.owes_whole = true;
    }

    /// Cuts a neighbour off for good.
    pub(crate) fn cut_off(&mut self, station: StationId) {
        self.links.remove(&station);
        self.cut.insert(station);
    }

    /// Removes the neighbours that have not been heard for long, and returns them.
    pub(crate) fn remove_gone(&mut self, now: Duration) -> Vec<StationId> {
        let is_gone = |link: &Link| link.heard + GONE_AFTER < now;
        let gone = self.links.iter().filter(|(_, link)| is_gone(link)).map(|(id, _)| *id);
        let gone: Vec<StationId> = gone.collect();
        gone.iter().for_each(|station| _ = self.links.remove(station));
        gone
    }

    /// How far away the neighbours are, and how slow their clients.
    pub(crate) fn abroad(&self) -> Abroad {
        let most =
            |of: fn(&Link) -> Duration| self.links.values().map(of).max().unwrap_or_default();
        let Self { links, .. } = self;
        debug_assert!(self.own.is_some() || links.is_empty(), "only stations have neighbours");
        Abroad { bus: most(Link::delay), slowest: most(|l| l.slowest), silent: most(|l| l.silent) }
    }

    /// Says something to a neighbour, if it is ready to hear.
    pub(crate) fn send(&mut self, now: Duration, to: StationId, word: StationWord) {
        let message = self.links.get_mut(&to).and_then(|link| link.next(now, word));
        self.outputs.extend(message.map(|message| StationOutput { to: Some(to), message }));
    }

    /// Says that this station is there, when it is time to. `slowest` and `silent` are the longest
    /// round trips of its clients, and of those that may be silent.
    pub(crate) fn beat(&mut self, now: Duration, slowest: Duration, silent: Duration) {
        if self.own.is_none() || now < self.next_beat {
            return;
        }
        self.next_beat = now + HEARTBEAT;
        for (station, link) in &self.links {
            let heard = link.heard_of(now, *station).into_iter().collect();
            let word = StationWord::Heartbeat(Heartbeat { slowest, silent, heard });
            let message =
                StationMessage { epoch: link.epoch, known: 0, number: 0, sent: now, word };
            self.outputs.push(StationOutput { to: Some(*station), message });
        }
        let word = StationWord::Heartbeat(Heartbeat { slowest, silent, heard: Vec::new() });
        let message = StationMessage { epoch: GREETING, known: 0, number: 0, sent: now, word };
        self.outputs.push(StationOutput { to: None, message });
    }

    /// Tells the neighbours what has changed of the subscription.
    pub(crate) fn publish_subscription(&mut self, now: Duration) {
        let ready: Vec<StationId> = self.ready().map(|(id, _)| id).collect();
        let subscribe = |change: subscription::Change| StationWord::Subscribe {
            number: change.number,
            added: change.added,
            removed: change.removed,
        };
        let change = self.subscription.change(now);
        let owes = |link: &Link| link.is_ready && link.owes_whole;
        let owes_whole = std::mem::take(&mut self.owes_whole) | self.links.values().any(owes);
        let whole = owes_whole.then(|| self.subscription.whole());
        for station in ready {
            let owed = self.links.get_mut(&station).map(|l| std::mem::take(&mut l.owes_whole));
            let change = if whole.is_some() { &whole } else { &change };
            debug_assert!(owed == Some(false) || whole.is_some(), "a newcomer is told all");
            if let Some(change) = change.clone() {
                self.send(now, station, subscribe(change));
            }
        }
        let answered = self.links.values().map(|link| link.synced).min();
        self.subscription.sync(answered.unwrap_or(u32::MAX));
    }

    /// Takes what is to be said on the bus.
    pub(crate) fn take_outputs(&mut self) -> Vec<StationOutput> {
        std::mem::take(&mut self.outputs)
    }

    /// Whether an avatar that others have been told of so may be silent where its body can be in
    /// these sectors, in a certain box, and may see those sectors. Whoever may see it must have
    /// agreed, and whom it may see must be known.
    pub(crate) fn allow(
        &self,
        relays: &[Relay],
        bodies: &[u32],
        seen: &BitSet,
        stay: &Stay,
    ) -> bool {
        debug_assert!(self.are_several(), "alone, nobody need agree");
        let agrees = |station: StationId| {
            let relay = relays.iter().find(|relay| relay.station == station);
            relay.is_some_and(|relay| match relay.order {
                RelayOrder::Live(_) => false,
                RelayOrder::Quiet(agreed) => {
                    agreed.within.contains_box(&stay.within)
                        && (stay.notice.is_zero() || stay.notice >= agreed.notice)
                }
            })
        };
        let touches = |link: &Link| bodies.iter().any(|sector| link.wants.contains(*sector));
        let mut links = self.links.iter();
        links.all(|(station, link)| !touches(link) || agrees(*station))
            && relays.iter().all(|relay| agrees(relay.station))
            && self.subscription.knows(seen)
    }
}

//! Silence among several stations: avatars of other stations that stay in a box here, and avatars
//! of this one that others must agree to.

use sightline_world::motion::{ReportingState, Tbv};

use super::{
    Silencing,
    search::{GUEST_VALIDITY, Silence},
};
use crate::{
    bus::Stay,
    config::StationFault,
    regions::{HiddenFootprint, Reach},
    slot::{Member, Slot},
};

impl Silencing<'_> {
    /// Whether no other station is against it that an avatar of this one is silent in a TBV.
    pub(super) fn others_allow(&self, slot: Slot, tbv: &Tbv, footprint: &HiddenFootprint) -> bool {
        let (stations, sectors) = (self.context.stations, &self.context.building.sectors);
        let avatar = self.population.at(slot);
        let is_faulty = self.context.config.faults.station == Some(StationFault::SilenceUnasked);
        if avatar.is_guest() || !stations.are_several() || is_faulty {
            return true;
        }
        let seen = sectors.visible_from(&footprint.sectors.eyes);
        let stay = Stay { within: tbv.within, notice: tbv.notice };
        stations.allow(&avatar.relays, &footprint.sectors.bodies, &seen, &stay)
    }

    /// Takes in that an avatar of another station that has just been announced stays in a box. If
    /// it may be seen there, that station is asked for it.
    pub(crate) fn let_stay(&mut self, slot: Slot, stay: &Stay) {
        let building = self.context.building;
        let start = self.population.at(slot).motion(self.context).start(building);
        let reach = Reach::in_box(&mut self.workspace.reach, &start, &stay.within);
        let footprint = HiddenFootprint::of_reach(building, &mut self.workspace.reach, &reach);
        let is_seen = self.is_seen(slot, &footprint);
        let Stay { within, notice } = *stay;
        let (axes, validity) = (*building.axes(), GUEST_VALIDITY);
        let tbv = Tbv { within, axes, expiry: self.context.now + validity, notice };
        self.hide(slot, Silence { tbv, sphere: None, footprint, validity });
        if is_seen {
            self.ask_to_be_live(slot);
        }
    }

    /// Asks the client of a hidden avatar, or another station, to report from now on.
    pub(crate) fn ask_to_be_live(&mut self, slot: Slot) {
        let avatar = self.population.at(slot);
        let member = Member { id: avatar.id, slot };
        let mut outputs = Vec::new();
        self.reveal_all(vec![member], &mut outputs);
        self.pending.append(&mut outputs);
    }

    /// Takes in a report of another station of one of its avatars, which has heard so many orders.
    /// One that stayed has left its box, or an ask is answered. If the order to stay was still on
    /// its way, the other station looks into it when that comes.
    pub(crate) fn hear_guest(&mut self, slot: Slot, orders: u32) {
        let avatar = self.population.at(slot);
        if avatar.state != ReportingState::Live && avatar.orders.are_heard(orders) {
            self.wake(slot);
        }
    }
}

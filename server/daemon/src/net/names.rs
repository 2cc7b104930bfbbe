//! Names: each is unique while its owner is there, and none looks like another one.

use std::{
    collections::{HashMap, HashSet},
    hash::{BuildHasher, RandomState},
};

use sightline_protocol::{
    fingerprint::{KEY_BYTES, KeyFingerprint},
    text::{NAME_CHARS_MAX, Name},
};
use sightline_world::motion::AvatarId;
use unicode_security::skeleton;

use crate::bus::name_claims::NameClaims;

/// Names that people take for the server's own. Nobody has one that looks like one of these.
const RESERVED: [&str; 10] = [
    "Admin",
    "Administrator",
    "Host",
    "Mod",
    "Moderator",
    "Owner",
    "Server",
    "Sightline",
    "Staff",
    "System",
];
/// The name of those who ask for a reserved one.
const VISITOR: &str = "Visitor";
/// Small numbers are tried first, then random ones up to this.
const SMALL_NUMBERS: std::ops::RangeInclusive<u64> = 2..=9;
const NUMBER_MAX: u64 = 999_999;
/// When other stations have this many of the names that were tried, only random numbers are.
const TAKEN_MAX: usize = 4;

/// What a name looks like. Two names with a form in common look alike.
type Forms = [String; 2];

/// The names of all clients.
#[derive(Debug, Default)]
pub struct Names {
    owned: HashMap<AvatarId, Forms>,
    /// The forms of all names, and of those that are kept for somebody.
    forms: HashSet<String>,
    /// What claims names at other stations, too.
    claims: Option<NameClaims>,
}

impl Names {
    /// Names that are claimed at other stations, too.
    pub fn at_all_stations(claims: Option<NameClaims>) -> Self {
        Self { claims, ..Self::default() }
    }

    /// What claims names at other stations, too.
    pub fn claims(&self) -> Option<&NameClaims> {
        self.claims.as_ref()
    }

    /// The name that a client has from now on: the one that it wants, or that one with a number if
    /// somebody has one that looks alike.
    pub fn claim(&mut self, avatar: AvatarId, wanted: &Name) -> Name {
        let name = self.keep(wanted, &[]);
        self.give(avatar, &name);
        name
    }

    /// Gives a client a name that was kept for it.
    pub fn give(&mut self, avatar: AvatarId, kept: &Name) {
        self.owned.insert(avatar, forms(kept.as_str()));
    }

    /// Lets go of a name that was kept for somebody.
    pub fn drop_kept(&mut self, kept: &Name) {
        self.let_go(forms(kept.as_str()));
    }

    /// Keeps a name for a client that wants one: the same, or that one with a number if somebody
    /// has one that looks alike. Those that others are known to have are not tried.
    pub fn keep(&mut self, wanted: &Name, taken: &[Name]) -> Name {
        let is_reserved = begins_with_fingerprint(wanted.as_str())
            || RESERVED.iter().any(|name| look_alike(&forms(name), &forms(wanted.as_str())));
        let base = if is_reserved { VISITOR } else { wanted.as_str() };
        let random = RandomState::new();
        // Each that another station has taken costs a question on the bus.
        let small = SMALL_NUMBERS.filter(|_| taken.len() < TAKEN_MAX);
        let numbers = small.chain((0..).map(|i: u64| random.hash_one(i) % NUMBER_MAX));
        let mut candidates = std::iter::once(Name::clipped(base))
            .chain(numbers.map(|number| numbered(base, number)));
        // There are more numbers than clients.
        let is_free = |name: &Name| {
            !taken.contains(name) && forms(name.as_str()).iter().all(|f| !self.forms.contains(f))
        };
        let name = candidates.find(is_free).unwrap_or_else(|| Name::clipped(VISITOR));
        self.forms.extend(forms(name.as_str()));
        name
    }

    /// Takes in that a client has gone.
    pub fn release(&mut self, avatar: AvatarId) {
        if let Some(forms) = self.owned.remove(&avatar) {
            self.let_go(forms);
        }
    }

    fn let_go(&mut self, forms: Forms) {
        for form in &forms {
            self.forms.remove(form);
        }
        if let Some(claims) = &self.claims {
            claims.release(distinct(forms));
        }
    }
}

/// A name with a number behind it.
fn numbered(base: &str, number: u64) -> Name {
    let number = format!(" {number}");
    let kept: String = base.chars().take(NAME_CHARS_MAX - number.len()).collect();
    Name::clipped(&(kept + &number))
}

/// Whether the first word of a name begins with the fingerprint of a key. Moderators name people by
/// either, so a command about the one would be done to the other.
fn begins_with_fingerprint(name: &str) -> bool {
    let word = name.split_whitespace().next().unwrap_or_default();
    let is_one = |text: &str| {
        let digits: String = text.chars().filter(|c| *c != '-').take(2 * KEY_BYTES).collect();
        digits.parse::<KeyFingerprint>().is_ok()
    };
    // What only looks like one is read as one. The skeleton has letters for the digits 0 and 1.
    let digit = |c: char| match c {
        'O' => '0',
        'l' => '1',
        c => c,
    };
    let looks: String = skeleton(word).filter(char::is_ascii).map(digit).collect();
    is_one(word) || is_one(&looks)
}

/// What a name looks like, for other stations.
pub fn forms_of(name: &Name) -> Vec<String> {
    distinct(forms(name.as_str()))
}

fn distinct(forms: Forms) -> Vec<String> {
    let mut forms = forms.to_vec();
    forms.dedup();
    forms
}

/// What a name looks like, as it is written and in small letters: a great I looks like an l, and a
/// small one does not. Spaces and what only selects a form do not count.
fn forms(name: &str) -> Forms {
    let counts = |c: &char| !c.is_whitespace() && !matches!(c, '\u{fe00}'..='\u{fe0f}');
    let form = |text: &str| skeleton(text).filter(counts).collect::<String>().to_lowercase();
    [form(name), form(&name.to_lowercase())]
}

fn look_alike(one: &Forms, other: &Forms) -> bool {
    one.iter().any(|form| other.contains(form))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn claim(names: &mut Names, id: u32, wanted: &str) -> String {
        names.claim(AvatarId(id), &Name::new(wanted).unwrap()).into()
    }

    #[test]
    fn a_name_is_unique_while_its_owner_is_there() {
        let mut names = Names::default();
        assert_eq!(claim(&mut names, 1, "Ada"), "Ada");
        assert_eq!(claim(&mut names, 2, "Ada"), "Ada 2");
        assert_eq!(claim(&mut names, 3, "Ada 2"), "Ada 2 2");
        names.release(AvatarId(1));
        assert_eq!(claim(&mut names, 4, "Ada"), "Ada");
        let taken = ["Cy", "Cy 2", "Cy 3", "Cy 4"].map(|name| Name::new(name).unwrap());
        let kept = [3, 4].map(|known| names.keep(&taken[0], &taken[..known]));
        assert!(kept[0] == taken[3] && kept[1].as_str() != "Cy 5", "{kept:?}");
        kept.iter().for_each(|name| names.drop_kept(name));
        let long = "x".repeat(NAME_CHARS_MAX);
        assert_eq!(claim(&mut names, 5, &long), long);
        assert_eq!(claim(&mut names, 6, &long).chars().count(), NAME_CHARS_MAX);
        let all: HashSet<String> = (10..1_010).map(|id| claim(&mut names, id, "Bo")).collect();
        assert_eq!(all.len(), 1_000);
        (0..1_010).for_each(|id| names.release(AvatarId(id)));
        assert!(names.forms.is_empty() && names.owned.is_empty());
    }

    #[test]
    fn nobody_is_called_by_a_fingerprint() {
        let mut names = Names::default();
        let key = KeyFingerprint([0xab; KEY_BYTES]).to_string();
        let plain = key.replace('-', "").to_uppercase();
        for (id, wanted) in (1..).zip([&key, &plain, &format!("{key} bo"), &format!("-{plain}xyz")])
        {
            assert!(claim(&mut names, id, wanted).starts_with("Visitor"), "{wanted}");
        }
        assert_eq!(claim(&mut names, 9, "Ada abab-abab"), "Ada abab-abab");
        // Digits that look alike, and a selector that does not show.
        let other = KeyFingerprint([0x0a; KEY_BYTES]).to_string();
        let alike = [
            ('a', "\u{ff41}"),
            ('a', "\u{430}"),
            ('0', "O"),
            ('0', "\u{ff10}"),
            ('a', "a\u{fe00}"),
        ];
        for (id, (digit, like)) in (20..).zip(alike) {
            let wanted = other.replacen(digit, like, 1);
            assert!(claim(&mut names, id, &wanted).starts_with("Visitor"), "{wanted}");
        }
    }

    #[test]
    fn nobody_gets_a_name_that_looks_like_another_or_like_the_servers() {
        let mut names = Names::default();
        let present = ["Ada", "Ivan", "Nicole", "Oscar"];
        for (id, name) in (1..).zip(present) {
            assert_eq!(claim(&mut names, id, name), name);
        }
        // Latin letters, and others that look like them.
        let alike = [
            ('a', "аɑａ𝐚𝑎𝒂𝓪𝔞𝕒𝖆𝖺𝗮𝘢𝙖𝚊"),
            ('c', "сϲｃ𝐜𝑐𝒄𝓬𝔠𝕔𝖈𝖼𝗰𝘤𝙘𝚌"),
            ('o', "оο𝐨𝑜𝒐𝓸𝔬𝕠𝖔𝗈𝗼𝘰𝙤𝚘ｏ"),
            ('i', "іｉ𝐢𝑖𝒊𝓲𝔦𝕚𝖎𝗂𝗶𝘪𝙞𝚒"),
            ('l', "Ⅼⅼ𝐥𝑙𝒍𝓵𝔩𝕝𝖑𝗅𝗹𝘭𝙡𝚕"),
            ('A', "АΑＡ𝐀𝐴𝑨𝒜𝓐𝔸𝕬𝖠𝗔𝘈𝘼𝙰"),
            ('I', "lІΙ|𝐈𝐼𝑰𝓘𝕀𝕴𝖨𝗜𝘐𝙄𝙸"),
        ];
        let mut tried = 0;
        for name in present.into_iter().chain(["Admin", "Moderator", "System"]) {
            for (letter, others) in alike {
                for other in others.chars() {
                    let wanted = name.replacen(letter, &other.to_string(), 1);
                    if wanted == name {
                        continue;
                    }
                    tried += 1;
                    let got = claim(&mut names, 1_000 + tried, &wanted);
                    assert!(!look_alike(&forms(&got), &forms(name)), "{wanted} became {got}");
                }
            }
        }
        assert!(tried >= 200, "{tried} names");
        for wanted in ["Admin", "ADMIN", "admin", "ad min", "Αdmin"] {
            assert!(claim(&mut names, 5_000 + wanted.len() as u32, wanted).starts_with("Visitor"));
        }
    }
}

//! The commands of the chat line: lines that begin with a slash.

use sightline_protocol::fingerprint::KeyFingerprint;

use super::moderation::{Author, Moderation, ModerationError, VisitorInfo};
use crate::people::{Role, RoleError, Subject, SubjectError};

/// The most visitors that one answer lists.
const LISTED_MAX: usize = 20;
/// What everybody is told about commands.
const HELP: &str = "/help lists the commands; a line without a slash is said to all in sight";
/// What moderators are told about commands. NAME may be a fingerprint, too.
const HELP_MODERATOR: [&str; 6] = [
    "/who [NAME] lists visitors with their roles and the fingerprints of their keys",
    "/kick NAME [REASON] removes somebody, who may come again",
    "/mute NAME [REASON] and /unmute NAME: nobody hears what somebody says",
    "/ban NAME [REASON] keeps somebody out, /ban-network NAME [REASON] all of the network",
    "/unban FINGERPRINT or /unban NETWORK lets in again",
    "/allow FINGERPRINT puts somebody on the list of those who are let in",
];
/// What owners are told as well.
const HELP_OWNER: &str = "/role NAME visitor, moderator or owner gives somebody a role";

/// Why a command is not done.
#[derive(Debug, thiserror::Error)]
enum CommandError {
    #[error(transparent)]
    Moderation(#[from] ModerationError),
    #[error(transparent)]
    Subject(#[from] SubjectError),
    #[error(transparent)]
    Role(#[from] RoleError),
    #[error("{0}")]
    Key(#[from] sightline_protocol::fingerprint::KeyFingerprintError),
    #[error("there is no command /{0}: see /help")]
    Unknown(String),
}

/// Does what a line without its slash says. Returns what its author is told.
pub fn run(moderation: &Moderation, author: KeyFingerprint, line: &str) -> Vec<String> {
    let (command, rest) = line.split_once(' ').unwrap_or((line, ""));
    let done = answer(moderation, Author::Visitor(author), command, rest.trim());
    done.unwrap_or_else(|error| vec![error.to_string()])
}

fn answer(
    moderation: &Moderation,
    author: Author,
    command: &str,
    rest: &str,
) -> Result<Vec<String>, CommandError> {
    let is_at_least = |role| moderation.check_role(author, role);
    if command == "help" {
        let mut lines = vec![HELP.to_owned()];
        if is_at_least(Role::Moderator).is_ok() {
            lines.extend(HELP_MODERATOR.map(str::to_owned));
        }
        if is_at_least(Role::Owner).is_ok() {
            lines.push(HELP_OWNER.to_owned());
        }
        return Ok(lines);
    }
    is_at_least(Role::Moderator)?;
    let visitors = moderation.visitors();
    let done = match command {
        "who" => return Ok(list(&visitors, rest)),
        "kick" => {
            let Target { key, name, reason } = target(&visitors, rest)?;
            moderation.kick(author, key, reason)?;
            format!("{name} is removed")
        }
        "mute" => {
            let Target { key, name, reason } = target(&visitors, rest)?;
            moderation.set_muted(author, key, true, reason)?;
            format!("{name} is muted")
        }
        "unmute" => {
            let Target { key, name, reason } = target(&visitors, rest)?;
            moderation.set_muted(author, key, false, reason)?;
            format!("{name} may speak again")
        }
        "ban" => {
            let Target { key, name, reason } = target(&visitors, rest)?;
            moderation.ban(author, Subject::Key(key), reason)?;
            format!("{name} is banned: /unban {key} lets them in again")
        }
        "ban-network" => {
            let Target { key, reason, .. } = target(&visitors, rest)?;
            let network = moderation.network_of(key)?;
            moderation.ban(author, network, reason)?;
            format!("{network} is banned: /unban {network} lets it in again")
        }
        "unban" => {
            let subject: Subject = rest.parse()?;
            moderation.unban(author, subject)?;
            format!("{subject} is let in again")
        }
        "allow" => {
            let key = rest.parse()?;
            moderation.allow(author, key)?;
            format!("{key} is let in")
        }
        "role" => {
            let Target { key, name, reason: role } = target(&visitors, rest)?;
            let role: Role = role.parse()?;
            moderation.set_role(author, key, role)?;
            format!("{name} is {role} now")
        }
        unknown => return Err(CommandError::Unknown(unknown.to_owned())),
    };
    Ok(vec![done])
}

/// Whom a command is about, and what follows.
#[derive(Debug, PartialEq, Eq)]
struct Target<'a> {
    key: KeyFingerprint,
    /// The name, or the fingerprint of somebody who is not here.
    name: String,
    reason: &'a str,
}

/// Finds whom a line begins with: a name with or without spaces, or the fingerprint of a key.
fn target<'a>(visitors: &[VisitorInfo], line: &'a str) -> Result<Target<'a>, ModerationError> {
    let (word, after) = line.split_once(' ').unwrap_or((line, ""));
    if let Ok(key) = word.parse::<KeyFingerprint>() {
        let named = visitors.iter().find(|visitor| visitor.key == key.to_string());
        let name = named.map_or_else(|| key.to_string(), |visitor| visitor.name.clone());
        return Ok(Target { key, name, reason: after.trim() });
    }
    let reason_after = |name: &str| {
        let after = line.strip_prefix(name)?;
        (after.is_empty() || after.starts_with(' ')).then(|| after.trim())
    };
    let named = visitors.iter().filter_map(|visitor| Some((visitor, reason_after(&visitor.name)?)));
    // "Ada 2" is not Ada, for the reason 2.
    let (visitor, reason) =
        named.max_by_key(|(visitor, _)| visitor.name.len()).ok_or(ModerationError::NotHere)?;
    // Nor is it when the one who was called so has left.
    let word = reason.split(' ').next().unwrap_or_default();
    if !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_digit()) {
        return Err(ModerationError::NotHere);
    }
    let key = visitor.key.parse().map_err(|_| ModerationError::NotHere)?;
    Ok(Target { key, name: visitor.name.clone(), reason })
}

/// The visitors whose names contain a text.
fn list(visitors: &[VisitorInfo], text: &str) -> Vec<String> {
    let found: Vec<_> = visitors.iter().filter(|visitor| visitor.name.contains(text)).collect();
    let line = |visitor: &&VisitorInfo| {
        let VisitorInfo { name, role, key, .. } = visitor;
        let muted = if visitor.is_muted { ", muted" } else { "" };
        format!("{name}: {role}{muted}, key {key}")
    };
    let mut lines: Vec<String> = found.iter().take(LISTED_MAX).map(line).collect();
    match found.len() {
        0 => lines.push("nobody of that name is here".to_owned()),
        count if count > LISTED_MAX => lines.push(format!("and {} more", count - LISTED_MAX)),
        _ => {}
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn visitor(name: &str, number: u8) -> VisitorInfo {
        VisitorInfo {
            avatar: number.into(),
            key: KeyFingerprint([number; 10]).to_string(),
            name: name.to_owned(),
            role: Role::Visitor,
            address: "192.0.2.1".parse().unwrap(),
            is_connected: true,
            is_muted: number == 3,
        }
    }

    #[test]
    fn the_longest_name_that_fits_is_meant() {
        let visitors = [visitor("Ada", 1), visitor("Ada 2", 2), visitor("Adalbert", 3)];
        let meant = |line| target(&visitors, line).map(|t| (t.key.0[0], t.reason));
        assert_eq!(meant("Ada"), Ok((1, "")));
        assert_eq!(meant("Ada 2"), Ok((2, "")));
        assert_eq!(meant("Ada 2 was rude"), Ok((2, "was rude")));
        assert_eq!(meant("Ada 22"), Err(ModerationError::NotHere), "a namesake who has left");
        assert_eq!(meant("Ada 22 was rude"), Err(ModerationError::NotHere));
        assert_eq!(meant("Ada 2nd warning"), Ok((1, "2nd warning")));
        assert_eq!(meant("Adalbert"), Ok((3, "")));
        assert_eq!(meant("Adal"), Err(ModerationError::NotHere));
        assert_eq!(meant(""), Err(ModerationError::NotHere));
        let line = format!("{} no", KeyFingerprint([9; 10]));
        assert_eq!(meant(&line), Ok((9, "no")), "somebody who is not here");
    }

    #[test]
    fn a_list_names_no_more_than_fit() {
        let visitors: Vec<_> = (0..30).map(|i| visitor(&format!("V{i}"), i)).collect();
        let all = list(&visitors, "");
        assert_eq!((all.len(), all[20].as_str()), (21, "and 10 more"));
        assert_eq!(
            list(&visitors, "V3")[0],
            format!("V3: visitor, muted, key {}", visitors[3].key)
        );
        assert_eq!(list(&visitors, "W"), ["nobody of that name is here"]);
    }
}

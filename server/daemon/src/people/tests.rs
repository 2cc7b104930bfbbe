//! What is remembered, after restarts and after kills.

use std::{
    io::{BufRead, BufReader},
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use super::*;

const ADA: KeyFingerprint = KeyFingerprint([1; 10]);
const BO: KeyFingerprint = KeyFingerprint([2; 10]);
const CY: KeyFingerprint = KeyFingerprint([3; 10]);

fn place(people: &People, key: KeyFingerprint, building: &str) -> Option<Vec3> {
    people.last_place(key, building).map(|(eye, _)| eye)
}

fn network(text: &str) -> IpAddr {
    text.parse().unwrap()
}

#[test]
fn chat_is_kept_for_as_long_as_it_is_to_be_and_only_if_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let say = |days, text: &str| {
        let people = People::open(Some(folder.path()), days).unwrap();
        people.note_chat(ADA, &Name::new("Ada").unwrap(), &ChatLine::new(text).unwrap());
        people.act("operator", Act::SetMuted(ADA, true), text);
    };
    let database = || Database::open(folder.path()).unwrap();
    let said = || {
        let records = database().chat(2).unwrap();
        records.into_iter().map(|record| record.name + " " + &record.text).collect::<Vec<_>>()
    };
    ["one", "two", "three"].into_iter().for_each(|text| say(1, text));
    assert_eq!(said(), ["Ada two", "Ada three"], "the last ones, in order");
    let reasons: Vec<String> =
        database().audit(9).unwrap().into_iter().map(|record| record.reason).collect();
    assert_eq!(reasons, ["one", "two", "three"]);
    rows(folder.path(), "UPDATE chat SET at = at - 90000 WHERE text = 'three' RETURNING ''");
    database().forget(1).unwrap();
    assert_eq!(said(), ["Ada one", "Ada two"]);
    say(0, "four");
    assert_eq!(said(), [""; 0], "nothing of it stays where it is not kept");
}

#[test]
fn a_restarted_server_remembers_everything() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("new");
    let (here, there) = (network("2001:db8::7"), network("192.0.2.1"));
    let house: Arc<str> = "house".into();
    let people = People::open(Some(&data), 0).unwrap();
    assert_eq!(people.standing(ADA), Standing::default());
    people.note_name(ADA, &Name::new("Ada").unwrap());
    people.note_places(&house, &[(ADA, Vec3::new(1.0, 2.0, 3.5))]);
    assert_eq!(
        place(&people, ADA, "house"),
        Some(Vec3::new(1.0, 2.0, 3.5)),
        "before it is written"
    );
    people.act("operator", Act::SetRole(ADA, Role::Owner), "");
    people.act("Ada", Act::SetMuted(BO, true), "loud");
    people.act("Ada", Act::Ban(Subject::Key(BO), "again".to_owned()), "again");
    people.act("Ada", Act::Ban(Subject::of(here), String::new()), "");
    people.act("Ada", Act::Ban(Subject::of(there), String::new()), "");
    people.act("Ada", Act::Unban(Subject::of(there)), "");
    drop(people);

    let people = People::open(Some(&data), 0).unwrap();
    let (ada, bo) = (people.standing(ADA), people.standing(BO));
    assert_eq!((ada.role, ada.is_muted), (Role::Owner, false));
    assert_eq!((bo.role, bo.is_muted), (Role::Visitor, true));
    assert!(people.is_banned(BO, there) && !people.is_banned(ADA, there));
    assert!(people.is_banned(CY, network("2001:db8::8")), "the whole network");
    assert!(!people.is_banned(ADA, network("2001:db8::8")), "but not its owner");
    assert!(!people.is_banned(CY, network("2001:db8:0:1::7")));
    assert_eq!(place(&people, ADA, "house"), Some(Vec3::new(1.0, 2.0, 3.5)));
    assert_eq!((place(&people, ADA, "other"), place(&people, BO, "house")), (None, None));
    people.note_places(&house, &[(ADA, Vec3::ONE)]);
    drop(people);
    let people = People::open(Some(&data), 0).unwrap();
    assert_eq!(place(&people, ADA, "house"), Some(Vec3::ONE));
    let audit = "SELECT group_concat(author || ' ' || act || ' ' || reason, ',') FROM audit";
    assert_eq!(
        rows(&data, audit),
        "operator make owner ,Ada mute loud,Ada ban again,Ada ban ,Ada ban ,Ada unban "
    );
    assert_eq!(rows(&data, "SELECT name FROM visitors WHERE role = 2"), "Ada");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(data.join("people.db")).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
    }
}

/// The only value of a query.
fn rows(data: &Path, sql: &str) -> String {
    let connection = rusqlite::Connection::open(data.join("people.db")).unwrap();
    connection.query_row(sql, [], |row| row.get(0)).unwrap()
}

#[test]
fn an_invitation_lets_in_as_many_as_it_says_and_they_stay_welcome() {
    let folder = tempfile::tempdir().unwrap();
    let hash = hash("come in");
    let people = People::open(Some(folder.path()), 0).unwrap();
    people.act("operator", Act::Invite(hash, 1), "");
    assert!(!people.accept_invitation(ADA, "let me in"));
    assert!(people.accept_invitation(ADA, "come in"));
    assert!(!people.accept_invitation(BO, "come in"));
    drop(people);
    let people = People::open(Some(folder.path()), 0).unwrap();
    assert!(people.standing(ADA).is_allowed && !people.standing(BO).is_allowed);
    assert!(!people.accept_invitation(BO, "come in"));
}

#[test]
fn what_another_program_writes_is_heard_of() {
    let folder = tempfile::tempdir().unwrap();
    let people = People::open(Some(folder.path()), 0).unwrap();
    let mut other = Database::open(folder.path()).unwrap();
    other.act("operator", Act::SetRole(ADA, Role::Owner), "").unwrap();
    let end = Instant::now() + Duration::from_secs(10);
    while people.standing(ADA).role != Role::Owner {
        assert!(Instant::now() < end, "it is heard of within a second");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn what_two_programs_rule_about_somebody_at_once_both_counts() {
    let folder = tempfile::tempdir().unwrap();
    let both = Standing { role: Role::Owner, is_muted: true, is_allowed: false };
    let people = People::open(Some(folder.path()), 0).unwrap();
    let mut other = Database::open(folder.path()).unwrap();
    people.act("Mo", Act::SetMuted(ADA, true), "");
    other.act("operator", Act::SetRole(ADA, Role::Owner), "").unwrap();
    let end = Instant::now() + Duration::from_secs(10);
    while people.standing(ADA) != both {
        assert!(Instant::now() < end, "{:?}", people.standing(ADA));
        std::thread::sleep(Duration::from_millis(20));
    }
    drop(people);
    assert_eq!(People::open(Some(folder.path()), 0).unwrap().standing(ADA), both);
}

#[cfg(feature = "bus")]
#[test]
fn what_other_servers_rule_is_kept_and_what_is_ruled_here_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let people = People::open(Some(folder.path()), 0).unwrap();
    let mut told = people.follow_rulings().unwrap();
    let subject = Subject::Key(ADA);
    people.act("Mo", Act::SetMuted(ADA, true), "loud");
    assert_eq!(told.try_recv(), Ok(subject));
    let mut other = Ruling::default();
    other.take(&Act::Ban(subject, "rude".to_owned()), now_ms());
    let before = people.merge("another station", subject, &other).expect("it is new");
    assert!(before.muted.is && before.banned.is.is_none());
    assert_eq!(people.merge("another station", subject, &other), None, "heard again");
    assert!(told.try_recv().is_err(), "others know of their own rulings");
    let now = people.ruling(&subject);
    drop(people);

    let people = People::open(Some(folder.path()), 0).unwrap();
    assert!(people.is_banned(ADA, None) && people.standing(ADA).is_muted);
    assert_eq!(people.ruling(&subject), now, "with its dates");
    let audit = Database::open(folder.path()).unwrap().audit(1).unwrap();
    let AuditRecord { author, act, reason, .. } = &audit[0];
    assert_eq!([author.as_str(), act, reason], ["another station", "ban", "rude"]);
    // What a command of the operator writes is told, too.
    let mut told = people.follow_rulings().unwrap();
    let mut operator = Database::open(folder.path()).unwrap();
    operator.act("operator", Act::SetRole(BO, Role::Owner), "").unwrap();
    let end = Instant::now() + Duration::from_secs(10);
    while told.try_recv() != Ok(Subject::Key(BO)) {
        assert!(Instant::now() < end, "within a second");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn what_was_ruled_before_there_were_dates_still_counts_and_can_be_lifted() {
    let folder = tempfile::tempdir().unwrap();
    let people = People::open(Some(folder.path()), 0).unwrap();
    people.act("Mo", Act::SetMuted(ADA, true), "");
    people.act("Mo", Act::Ban(Subject::Key(BO), "rude".to_owned()), "rude");
    drop(people);
    let connection = rusqlite::Connection::open(folder.path().join("people.db")).unwrap();
    connection
        .execute_batch(
            "DROP TABLE rulings; ALTER TABLE visitors DROP COLUMN placed; PRAGMA user_version = 2",
        )
        .unwrap();
    drop(connection);
    let people = People::open(Some(folder.path()), 0).unwrap();
    assert!(people.standing(ADA).is_muted && people.is_banned(BO, None));
    people.act("Mo", Act::SetMuted(ADA, false), "");
    people.act("Mo", Act::Unban(Subject::Key(BO)), "");
    drop(people);
    let people = People::open(Some(folder.path()), 0).unwrap();
    assert!(!people.standing(ADA).is_muted && !people.is_banned(BO, None));
}

/// The standings are read anew at any time, and what waits is then taken in again.
#[test]
fn an_act_is_in_the_standings_only_when_it_waits_to_be_written() {
    let people = People::open(None, 0).unwrap();
    let subject = Subject::Key(ADA);
    let pending = people.shared.pending();
    std::thread::scope(|scope| {
        scope.spawn(|| people.act("test", Act::Ban(subject, String::new()), ""));
        // The act cannot wait yet, so it keeps the standings to itself.
        while let Ok(standings) = people.shared.standings.try_lock() {
            assert!(!standings.is_banned(&subject), "it would be lost");
            drop(standings);
            std::thread::sleep(Duration::from_millis(1));
        }
        drop(pending);
    });
    assert!(people.is_banned(ADA, None));
}

#[test]
fn a_file_that_is_none_of_ours_or_a_later_ones_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("people.db");
    std::fs::write(&path, "not a database, but a text that is long enough".repeat(100)).unwrap();
    let error = People::open(Some(folder.path()), 0).err().unwrap();
    assert!(matches!(error, DatabaseError::Open { .. }), "{error}");
    std::fs::remove_file(&path).unwrap();
    drop(People::open(Some(folder.path()), 0).unwrap());
    let connection = rusqlite::Connection::open(&path).unwrap();
    connection.pragma_update(None, "user_version", 99).unwrap();
    let error = People::open(Some(folder.path()), 0).err().unwrap();
    assert!(matches!(error, DatabaseError::Later { .. }), "{error}");
}

/// How many rounds of killing a usual run of the tests has.
const ROUNDS: u64 = 3;
/// What was noted this long before a kill must be in the file.
const KEPT: Duration = Duration::from_secs(1);
const FOLDER: &str = "SIGHTLINE_TEST_PEOPLE";

#[test]
#[ignore = "the process that the tests below kill"]
fn writes_until_it_is_killed() {
    let folder = std::env::var(FOLDER).expect("its parent says where");
    let people = People::open(Some(Path::new(&folder)), 0).unwrap();
    let house: Arc<str> = "house".into();
    let first = place(&people, ADA, "house").map_or(0, |eye| eye.x as u32);
    for count in first + 1.. {
        people.note_places(&house, &[(ADA, Vec3::X * count as f32)]);
        people.act("test", Act::SetMuted(BO, count % 2 == 0), &count.to_string());
        println!("noted {count}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Kills a process that writes, again and again, and looks at what it leaves.
fn kill_again_and_again(rounds: u64) {
    let folder = tempfile::tempdir().unwrap();
    for round in 0..rounds {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "people::tests::writes_until_it_is_killed", "--ignored"])
            .arg("--nocapture")
            .env(FOLDER, folder.path())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut noted = vec![];
        // Kills fall at different times of the writer's turns.
        let life = KEPT + Duration::from_millis(300 + round * 137 % 400);
        let mut begin = None;
        for line in BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap) {
            let Some((_, count)) = line.split_once("noted ") else { continue };
            noted.push((Instant::now(), count.parse::<u32>().unwrap()));
            if begin.get_or_insert_with(Instant::now).elapsed() >= life {
                break;
            }
        }
        child.kill().unwrap();
        let killed = Instant::now();
        child.wait().unwrap();
        assert_eq!(rows(folder.path(), "PRAGMA integrity_check"), "ok");
        let old = noted.iter().rev().find(|(at, _)| killed - *at > KEPT);
        let (_, due) = old.expect("it lived for longer");
        let people = People::open(Some(folder.path()), 0).unwrap();
        let kept = place(&people, ADA, "house").map_or(0, |eye| eye.x as u32);
        assert!(kept >= *due, "round {round}: {due} was noted, and {kept} is kept");
        let last = rows(folder.path(), "SELECT reason FROM audit ORDER BY rowid DESC LIMIT 1");
        // The writer may have come between a place and the line about it, and nowhere else.
        let last: u32 = last.parse().unwrap();
        assert!(kept - last <= 1, "round {round}: place {kept}, audit log {last}");
    }
}

#[test]
fn a_kill_loses_at_most_the_last_second() {
    kill_again_and_again(ROUNDS);
}

#[test]
#[ignore = "takes two minutes"]
fn fifty_kills_lose_at_most_the_last_second() {
    kill_again_and_again(50);
}

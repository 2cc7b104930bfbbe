//! A browser that tests drive: Chromium, by the DevTools protocol over pipes.

use std::{
    io::{BufRead, BufReader, Write},
    path::{Path, PathBuf},
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    time::{Duration, Instant},
};

use base64::{Engine, prelude::BASE64_STANDARD};
use serde_json::{Value, json};

/// How long a page may take to come to a state.
const PATIENCE: Duration = Duration::from_secs(120);
/// The names by which Chromium may be installed.
const PROGRAMS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

/// A browser with one page, which ends with this.
pub struct Browser {
    process: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    session: String,
    last: u64,
    /// What the page did wrong.
    pub faults: Vec<String>,
    _profile: tempfile::TempDir,
}

impl Browser {
    /// Opens a page. `None` when Chromium is not installed.
    pub fn open(url: &str) -> Option<Self> {
        let program = installed()?;
        let profile = tempfile::tempdir().unwrap();
        // The browser reads commands from 3 and writes answers to 4.
        let pipes = "exec \"$0\" \"$@\" 3<&0 4>&1 0</dev/null 1>/dev/null 2>/dev/null";
        let mut process = Command::new("sh")
            .args(["-c", pipes])
            .arg(program)
            .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run"])
            .args(["--disable-background-networking", "--disable-component-update"])
            .args(["--remote-debugging-pipe", "--window-size=1500,1000"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let to = process.stdin.take().unwrap();
        let from = BufReader::new(process.stdout.take().unwrap());
        let (session, faults) = (String::new(), Vec::new());
        let mut browser = Self { process, to, from, session, last: 0, faults, _profile: profile };
        let target = browser.call("Target.createTarget", &json!({ "url": "about:blank" }));
        let target = json!({ "targetId": target["targetId"], "flatten": true });
        let attached = browser.call("Target.attachToTarget", &target);
        attached["sessionId"].as_str().unwrap().clone_into(&mut browser.session);
        for domain in ["Runtime.enable", "Log.enable", "Page.enable"] {
            browser.call(domain, &json!({}));
        }
        browser.call("Page.navigate", &json!({ "url": url }));
        Some(browser)
    }

    /// The value of an expression on the page.
    pub fn value(&mut self, expression: &str) -> Value {
        let asked =
            json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        self.call("Runtime.evaluate", &asked)["result"]["value"].take()
    }

    /// Waits until an expression holds on the page.
    pub fn until(&mut self, expression: &str) {
        let start = Instant::now();
        while self.value(expression) != json!(true) {
            assert!(start.elapsed() < PATIENCE, "not in time: {expression}; {:?}", self.faults);
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Writes a picture of the page.
    pub fn picture(&mut self, path: &Path) {
        let taken = self.call("Page.captureScreenshot", &json!({}));
        let bytes = BASE64_STANDARD.decode(taken["data"].as_str().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }

    /// Presses a key, and lets it go.
    pub fn key(&mut self, code: &str, key: &str) {
        self.hold(code, key, true);
        self.hold(code, key, false);
    }

    /// Presses a key, or lets it go.
    pub fn hold(&mut self, code: &str, key: &str, down: bool) {
        let kind = if down { "keyDown" } else { "keyUp" };
        let mut event = json!({ "type": kind, "code": code, "key": key });
        if down && key == "Enter" {
            (event["text"], event["windowsVirtualKeyCode"]) = (json!("\r"), json!(13));
        }
        self.call("Input.dispatchKeyEvent", &event);
    }

    /// Types a text where the cursor is.
    pub fn text(&mut self, text: &str) {
        self.call("Input.insertText", &json!({ "text": text }));
    }

    /// Calls a method of the protocol. Events that come before the answer are looked at.
    fn call(&mut self, method: &str, params: &Value) -> Value {
        self.last += 1;
        let mut asked = json!({ "id": self.last, "method": method, "params": params });
        if !self.session.is_empty() {
            asked["sessionId"] = json!(self.session);
        }
        let mut bytes = serde_json::to_vec(&asked).unwrap();
        bytes.push(0);
        self.to.write_all(&bytes).unwrap();
        loop {
            let mut said = Vec::new();
            self.from.read_until(0, &mut said).unwrap();
            assert_eq!(said.pop(), Some(0), "the browser has ended");
            let mut said: Value = serde_json::from_slice(&said).unwrap();
            if said["id"] == json!(self.last) {
                assert!(said["error"].is_null(), "{method}: {said}");
                return said["result"].take();
            }
            let is_fault = said["method"] == "Runtime.exceptionThrown"
                || said["params"]["entry"]["level"] == "error";
            if is_fault {
                self.faults.push(said.to_string());
            }
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn installed() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    let paths = std::env::split_paths(&folders);
    let mut programs = paths.flat_map(|folder| PROGRAMS.map(|program| folder.join(program)));
    programs.find(|program| program.is_file())
}

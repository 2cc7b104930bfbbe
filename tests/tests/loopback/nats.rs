//! A NATS server for tests.

use std::{
    io::Write,
    net::{TcpListener, TcpStream},
    path::Path,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use crate::PATIENCE;

/// A NATS server on loopback, with a user and a password. It ends when it is dropped.
pub struct Nats {
    child: Child,
    port: u16,
}

impl Nats {
    /// Starts one without JetStream. `None` where no program is, which is printed.
    pub fn start() -> Option<Self> {
        Self::start_with(free_port(), None)
    }

    /// Starts one that keeps what is shared in a folder.
    pub fn start_keeping(folder: &Path) -> Option<Self> {
        Self::start_with(free_port(), Some(folder))
    }

    /// Starts one again that was stopped, at the same port.
    pub fn again(port: u16, folder: Option<&Path>) -> Self {
        Self::start_with(port, folder).expect("it was there before")
    }

    fn start_with(port: u16, folder: Option<&Path>) -> Option<Self> {
        let arguments = ["-a", "127.0.0.1", "--user", "ada", "--pass", "l@ve", "-p"];
        let mut command = Command::new("nats-server");
        command.args(arguments).arg(port.to_string());
        if let Some(folder) = folder {
            command.arg("-js").arg("-sd").arg(folder);
        }
        let Ok(child) = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn() else {
            println!("skipped: nats-server is not installed");
            return None;
        };
        let began = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(began.elapsed() < PATIENCE, "NATS does not listen");
            std::thread::sleep(Duration::from_millis(20));
        }
        Some(Self { child, port })
    }

    /// Where stations find it.
    pub fn url(&self) -> String {
        format!("nats://ada:l%40ve@127.0.0.1:{}", self.port)
    }

    /// Publishes something, as anybody on the bus can.
    pub fn publish(&self, subject: &str, bytes: &[u8]) {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        let hello = r#"CONNECT {"user":"ada","pass":"l@ve","verbose":false}"#;
        // JetStream hears only of those who want an answer, though nobody waits for it here.
        write!(stream, "{hello}\r\nPUB {subject} test.answer {}\r\n", bytes.len()).unwrap();
        stream.write_all(bytes).unwrap();
        stream.write_all(b"\r\nPING\r\n").unwrap();
        // The answer to the ping says that all sent before was read.
        let mut said = Vec::new();
        let mut byte = [0];
        while !said.ends_with(b"PONG\r\n") {
            std::io::Read::read_exact(&mut stream, &mut byte).unwrap();
            said.extend(byte);
        }
    }

    /// Ends it. Returns its port.
    pub fn stop(mut self) -> u16 {
        self.end();
        self.port
    }

    fn end(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Nats {
    fn drop(&mut self) {
        self.end();
    }
}

fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

//! `delivery CLIP..`: how long clips take to arrive over a network that fails, as a table.
//!
//! A server of this process sends each clip at the rate of WiFi, in three ways: without a fault, with a silence of two
//! seconds in the middle, and with a lost connection at every tenth. In a network namespace `tc` paces the loopback
//! and `nft` drops one packet in a hundred. Without namespaces for this user, or without `ip` and `tc`, the server
//! paces; without `nft` no packet is lost. Loss comes without delay: a loopback has none, and few systems have the
//! kernel's netem, which adds some.

use std::env;
use std::path::Path;
use std::process::{Command, ExitCode, ExitStatus, Stdio};
use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use aarc_tests::server::{Answer, Request, Server};
use client::content::transfer::Options;
use client::content::{Download, OpenEvent};

/// The paper's network, in megabits per second.
const MBIT: f64 = 58.0;

/// Downloads of each clip under each condition.
const RUNS: usize = 11;

/// How long a server is silent: less than what counts as a break.
const STALL: Duration = Duration::from_secs(2);

/// What `ip` does to the loopback of the namespace. Packets are as on a network: a loopback's packets have 64 KiB,
/// too few for a loss of one in a hundred to count.
const LINK: &str = "link set lo up mtu 1500 gso_max_segs 1 gso_max_size 1500";

/// First argument of the process in the namespace.
const INSIDE: &str = "--inside";

/// What the network does to a clip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Condition {
    Clean,
    Loss,
    Stall,
    Cuts,
}

impl Condition {
    const ALL: [Condition; 4] = [Condition::Clean, Condition::Loss, Condition::Stall, Condition::Cuts];

    fn name(self) -> &'static str {
        match self {
            Condition::Clean => "nothing",
            Condition::Loss => "1% of packets lost",
            Condition::Stall => "2 s of silence in the middle",
            Condition::Cuts => "cut at every tenth",
        }
    }
}

fn main() -> ExitCode {
    let args: Vec<String> = env::args().skip(1).collect();
    let inside = args.first().is_some_and(|arg| arg == INSIDE);
    let clips = &args[usize::from(inside)..];
    if clips.is_empty() {
        eprintln!("error: name the clips: delivery CLIP..");
        return ExitCode::from(2);
    }
    if !inside && let Some(code) = enter(clips) {
        return code;
    }
    match measure(clips, inside) {
        Ok(()) => ExitCode::SUCCESS,
        Err(what) => {
            eprintln!("error: {what}");
            ExitCode::from(3)
        }
    }
}

/// Runs this program in a network namespace, and returns its exit code; `None` where there is none, or
/// none that can be paced.
fn enter(clips: &[String]) -> Option<ExitCode> {
    let unshare = || {
        let mut unshare = Command::new("unshare");
        unshare.args(["--net", "--map-root-user"]);
        unshare
    };
    let mut trial = unshare();
    trial.args(["sh", "-c", &format!("ip {LINK} && tc {}", pacing())]);
    let trial = trial.stdout(Stdio::null()).stderr(Stdio::null()).status();
    trial.ok().filter(ExitStatus::success)?;
    let status = unshare().arg(env::current_exe().ok()?).arg(INSIDE).args(clips).status().ok()?;
    // One that was killed has no code.
    Some(status.code().and_then(|code| u8::try_from(code).ok()).map_or(ExitCode::FAILURE, ExitCode::from))
}

/// What `tc` does to the loopback of the namespace.
fn pacing() -> String {
    format!("qdisc add dev lo root tbf rate {MBIT}mbit burst 3000 limit 500000")
}

/// Measures all conditions and prints the table. `inside` is whether the loopback is this process's own.
fn measure(clips: &[String], inside: bool) -> Result<(), String> {
    if inside {
        run("ip", LINK)?;
        run("tc", &pacing())?;
    }
    println!("| clip | bytes | what happens | first layer decoded, ms | whole clip decoded, ms |");
    println!("|---|--:|---|--:|--:|");
    for condition in Condition::ALL {
        let lossy = condition == Condition::Loss;
        let drops = if lossy && inside { drop_packets() } else { Err("the network is shared".into()) };
        if let (true, Err(why)) = (lossy, &drops) {
            println!("| | | {} | not measured: {why} | |", condition.name());
            continue;
        }
        for path in clips {
            let file: Arc<[u8]> = std::fs::read(path).map_err(|error| format!("{path}: {error}"))?.into();
            let bytes = file.len();
            let server = server(file, condition, inside);
            let mut times = Vec::new();
            for _ in 0..RUNS {
                times.push(download(&server.url("clip.aarc"))?);
            }
            let column = |which: fn(&[f64; 2]) -> f64| {
                let mut column: Vec<f64> = times.iter().map(which).collect();
                column.sort_by(f64::total_cmp);
                format!("{:.0} ({:.0} to {:.0})", column[RUNS / 2], column[0], column[RUNS - 1])
            };
            let name = Path::new(path).file_name().unwrap_or_default().to_string_lossy();
            let (first, whole) = (column(|times| times[0]), column(|times| times[1]));
            println!("| {name} | {bytes} | {} | {first} | {whole} |", condition.name());
        }
        if lossy {
            run("nft", "delete table inet loss")?;
        }
    }
    println!(
        "\nmedian of {RUNS} (least to most); {MBIT} Mbit/s by {}",
        if inside { "tc" } else { "the server" }
    );
    Ok(())
}

/// Has one in a hundred packets of TCP lost.
fn drop_packets() -> Result<(), String> {
    run(
        "nft",
        "add table inet loss; add chain inet loss arriving { type filter hook input priority 0; }; \
         add rule inet loss arriving meta l4proto tcp numgen random mod 100 < 1 drop",
    )
}

/// Runs a program with the words of a line as arguments.
fn run(program: &str, line: &str) -> Result<(), String> {
    let output = Command::new(program)
        .args(line.split_whitespace())
        .output()
        .map_err(|error| format!("{program}: {error}"))?;
    match output.status.success() {
        true => Ok(()),
        false => {
            let said = String::from_utf8_lossy(&output.stderr);
            Err(format!("{program}: {}", said.lines().next().unwrap_or_default()))
        }
    }
}

/// A server of one file; it paces what it sends where nothing else does.
fn server(file: Arc<[u8]>, condition: Condition, is_paced: bool) -> Server {
    let send = move |answer: &mut Answer<'_>, bytes: &[u8]| match is_paced {
        true => answer.raw(bytes),
        false => answer.paced(bytes, MBIT * 1e6 / 8.0),
    };
    Server::start(move |_, request: &Request, answer| {
        let part = answer.file_head(request, &file, "\"one\"");
        let length = file.len();
        match condition {
            Condition::Stall if part.contains(&(length / 2)) => {
                send(answer, &file[part.start..length / 2]);
                sleep(STALL);
                send(answer, &file[length / 2..part.end]);
            }
            Condition::Clean | Condition::Loss | Condition::Stall => {
                send(answer, &file[part]);
            }
            Condition::Cuts => {
                // Up to the next tenth that is not there yet.
                let end = (1..=10).map(|tenth| tenth * length / 10).find(|&end| end > part.start);
                send(answer, &file[part.start..end.unwrap_or(length).min(part.end)]);
            }
        }
    })
}

/// Downloads a clip; milliseconds until its first layer, and all of it, were decoded.
fn download(url: &str) -> Result<[f64; 2], String> {
    let start = Instant::now();
    let elapsed_ms = || start.elapsed().as_secs_f64() * 1e3;
    let mut opened = None;
    for event in Download::new(url, Options::default()) {
        if let OpenEvent::Take(take) = event.map_err(|fault| fault.to_string())? {
            opened = Some((take, elapsed_ms()));
        }
    }
    let (take, first_ms) = opened.ok_or_else(|| format!("{url}: no clip came"))?;
    take.segment(0, take.layers()[0]).map_err(|fault| fault.to_string())?;
    Ok([first_ms, elapsed_ms()])
}

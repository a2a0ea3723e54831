//! The `tsuya` program: one file a subcommand.

mod align;
mod ar;
mod bake;
mod brdf;
mod check;
mod compare;
mod comparison;
mod composite;
mod decode;
mod demo;
mod encode;
mod gltf;
mod hull;
mod info;
mod light;
mod make;
mod output;
mod pictures;
mod ply;
mod progress;
mod render;
mod repair;
mod shell;
mod source;
mod surroundings;
mod values;
mod verify;
mod view;

use anyhow::Result;
use clap::{ArgAction, Parser, Subcommand};
use std::process::ExitCode;

/// Files for objects captured with their measured appearance: photographs and a mesh in, one small file out, and back.
///
/// Exit codes: 0 done; 1 the command line asks for something wrong; 2 a file can't be read or written; 3 a file's content is
/// wrong; 4 a check or an operation failed, or a part of a file is lost; 5 valid, but not supported.
#[derive(Parser)]
#[command(name = "tsuya", version, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Threads to work with [default: one for each processor]. The output never depends on it.
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Memory that what is read may ask for, in MiB [default: 4096]: a .tsuya file, or a capture, pictures, meshes and tables.
    #[arg(long, global = true, value_name = "MIB")]
    max_memory: Option<u64>,
    /// Says more of what is done; twice: much more.
    #[arg(short, long, global = true, action = ArgAction::Count)]
    verbose: u8,
    /// Says nothing of what is done, but warnings, errors and what was asked for.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
}

#[derive(Subcommand)]
enum Command {
    Demo(demo::Demo),
    Encode(encode::Encode),
    Decode(decode::Decode),
    Info(info::Info),
    Verify(verify::Verify),
    Repair(repair::Repair),
    Compare(compare::Compare),
    Render(render::Render),
    Composite(composite::Composite),
    Make(make::Make),
    Align(align::Align),
    Check(check::Check),
    Hull(hull::Hull),
    Ar(Box<ar::Ar>),
    Brdf(brdf::Brdf),
    Bake(bake::Bake),
    Light(light::Light),
    Gltf(gltf::Gltf),
    View(view::View),
    Completions(shell::Completions),
    Man(shell::Man),
}

impl Command {
    fn run(self) -> Result<()> {
        match self {
            Command::Demo(demo) => demo.run(),
            Command::Encode(encode) => encode.run(),
            Command::Decode(decode) => decode.run(),
            Command::Info(info) => info.run(),
            Command::Verify(verify) => verify.run(),
            Command::Repair(repair) => repair.run(),
            Command::Compare(compare) => compare.run(),
            Command::Render(render) => render.run(),
            Command::Composite(composite) => composite.run(),
            Command::Make(make) => make.run(),
            Command::Align(align) => align.run(),
            Command::Check(check) => check.run(),
            Command::Hull(hull) => hull.run(),
            Command::Ar(ar) => ar.run(),
            Command::Brdf(brdf) => brdf.run(),
            Command::Bake(bake) => bake.run(),
            Command::Light(light) => light.run(),
            Command::Gltf(gltf) => gltf.run(),
            Command::View(view) => view.run(),
            Command::Completions(completions) => completions.run(),
            Command::Man(man) => man.run(),
        }
    }
}

/// What exit codes say; the manual pages list them.
const EXIT_STATUS: [(u8, &str); 6] = [
    (0, "Done."),
    (1, "The command line asks for something wrong."),
    (2, "A file can't be read or written."),
    (3, "A file's content is wrong."),
    (4, "A check or an operation failed, or a part of a file is lost."),
    (5, "Valid, but not supported."),
];

/// Something that was tried or checked did not succeed, though all input could be read.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Failed(String);

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // Arguments, which it repeats, may be names of files from anywhere.
            if std::env::args_os().all(|argument| output::is_plain(&argument.to_string_lossy())) {
                let _ = error.print();
            } else {
                error.render().to_string().lines().for_each(output::eprint_line);
            }
            return ExitCode::from(error.use_stderr() as u8);
        }
    };
    let level = match cli.verbose {
        0 => tracing::Level::WARN,
        1 => tracing::Level::INFO,
        2 => tracing::Level::DEBUG,
        _ => tracing::Level::TRACE,
    };
    tracing_subscriber::fmt().with_max_level(level).with_writer(std::io::stderr).without_time().init();
    if let Some(mebibytes) = cli.max_memory {
        source::set_memory_limit(mebibytes);
    }
    if cli.quiet {
        output::be_quiet();
    }
    output::clean_up_on_signals();
    let repairs = matches!(cli.command, Command::Repair(_));
    let result = on_threads(cli.threads, || cli.command.run());
    if result.is_err() {
        output::wait_for_signal();
    }
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            output::eprint_line(&format!("tsuya: {}", error_chain(&error)));
            let code = exit_code(&error);
            if !repairs && is_damage(&error) {
                output::eprint_line("tsuya repair makes a whole file of what is left of a damaged one");
            }
            ExitCode::from(code)
        }
    }
}

fn on_threads(threads: Option<u16>, work: impl FnOnce() -> Result<()> + Send) -> Result<()> {
    match threads {
        Some(threads) => rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build()?.install(work),
        None => work(),
    }
}

/// The error with what it happened to; the library's errors name their own cause.
fn error_chain(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain() {
        if !text.is_empty() {
            text += ": ";
        }
        text += &output::with_flags(&cause.to_string());
        if cause.is::<tsuya::Error>() {
            break;
        }
    }
    text
}

fn exit_code(error: &anyhow::Error) -> u8 {
    use tsuya::Error;
    match error.chain().find_map(|cause| cause.downcast_ref::<Error>()) {
        Some(Error::Parameter(_)) => 1,
        Some(Error::Io { .. }) => 2,
        Some(Error::Format { .. } | Error::Input { .. }) => 3,
        Some(Error::Unsupported(_)) => 5,
        _ => 4,
    }
}

/// Whether a `.tsuya` file is wrong, and is one.
fn is_damage(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        matches!(cause.downcast_ref(), Some(tsuya::Error::Format { message, .. }) if !message.starts_with("not a .tsuya file"))
    })
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let broken = |e: &std::io::Error| e.kind() == std::io::ErrorKind::BrokenPipe;
    error.chain().any(|cause| cause.downcast_ref::<std::io::Error>().is_some_and(broken))
}

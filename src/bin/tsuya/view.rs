//! `tsuya view`: a file in the browser, or as a page for any web server.

mod answer;
mod body;
mod connections;
mod policy;
mod range;
mod references;
mod server;
mod site;

use crate::output;
use anyhow::Result;
use clap::Args;
use references::LeftOut;
use server::Server;
use site::Site;
use std::path::PathBuf;
use tsuya::Error;

/// Shows a file in the browser: looked at from all sides, under other lights. Serves the page on this machine alone until it is ended with Ctrl-C.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya view vase.tsuya\n",
    "  tsuya view vase.tsuya --export site/",
))]
pub struct View {
    /// The .tsuya, .glb or .gltf file.
    file: PathBuf,
    /// Port of the page's address, http://127.0.0.1:PORT/ [default: any that is free].
    #[arg(long, value_name = "PORT", default_value_t = 0, hide_default_value = true)]
    port: u16,
    /// Doesn't open the browser, only says the address.
    #[arg(long)]
    no_open: bool,
    /// Writes page and file into this folder, for any web server, and ends.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["port", "no_open"])]
    export: Option<PathBuf>,
    /// Takes the page's files from this folder, as tools/web/viewer/build makes it, instead of those within the program.
    #[arg(long, value_name = "DIR")]
    assets: Option<PathBuf>,
    /// Takes along whatever a .glb or .gltf file refers to: files outside its folder, hidden ones, links to elsewhere, files of any kind. For
    /// documents of your own only: all of it is served or exported.
    #[arg(long)]
    allow_outside: bool,
    /// With --export: writes into a folder that is not empty.
    #[arg(long, requires = "export")]
    force: bool,
}

impl View {
    pub fn run(self) -> Result<()> {
        let mut site = Site::new(&self.file, self.assets.as_deref(), self.allow_outside)?;
        self.tell_left_out(site.take_left_out())?;
        if let Some(folder) = &self.export {
            let made = output::Folder::create(folder, self.force, Some("index.html"), &[&self.file])?;
            for (path, content) in site.files() {
                made.write(path, &content.read()?)?;
            }
            made.commit()?;
            let (count, shown) = (site.files().count(), folder.display());
            return output::tell(&format!(
                "{shown}: {count} files; any web server shows them, opened as files they do not work\n"
            ));
        }
        let server = Server::bind(self.port, site)?;
        let address = server.address();
        output::print(&format!("{address}  (Ctrl-C ends)\n"))?;
        if !self.no_open && open::that_detached(&address).is_err() {
            output::eprint_line("no browser could be opened: open the address yourself");
        }
        server.run();
        Ok(())
    }

    /// Warns of files that the document refers to and that are left out. What is exported is published: there it is an error where one was
    /// refused.
    fn tell_left_out(&self, left_out: LeftOut) -> Result<()> {
        let more = |errors: &[Error]| match errors.len() {
            0 | 1 => String::new(),
            count => format!(" (and {} more)", count - 1),
        };
        let warn = |errors: &[Error]| {
            let warning = errors.first().map(|first| format!("{first}: left out{}", more(errors)));
            output::warn(warning.as_slice());
        };
        warn(&left_out.missing);
        if self.export.is_none() {
            warn(&left_out.refused);
            return Ok(());
        }
        let more = more(&left_out.refused);
        match left_out.refused.into_iter().next() {
            Some(first) => Err(anyhow::Error::new(first).context(format!("nothing is exported{more}"))),
            None => Ok(()),
        }
    }
}

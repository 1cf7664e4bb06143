//! States the commit that the binary is built from, and prepares the files of the web page, the documents and the
//! examples.

mod commit;
mod documents;
mod shorten;
mod web;

fn main() -> std::io::Result<()> {
    println!("cargo:rerun-if-changed=build");
    commit::state();
    web::compile()?;
    documents::compile()
}

"""The workbench in the browser (`sysid app`): what is done before and after a computation by eye.

It knows nothing of its own. An action is a call of `sysid.pipeline`, or a change of the campaign or
rig file, and the page shows the command and the lines that do the same; what is drawn are the
blocks of `sysid.blocks`. `server` listens on this machine alone and lets in who has the token;
`workbench` is what all windows share: the files, the `journal` of changes, which can be undone,
and the job at work (`jobs`: a `sysid` command in a process of its own); `edits` changes TOML
without touching the rest of it; `page` is one window, its `screens` one file each, made of
`parts`; `traces` draws long recordings.
"""

-- What is made of finished packings: meshes, voxels, cuts, lattice models.

-- One row for everything that was asked of a job's result, by whichever way; its file lies in the artifacts' folder.
-- The key names result, options and revision, so that the same thing is made once.
create table derived (
    seq         integer primary key autoincrement,
    id          text    not null unique,
    job         integer not null references jobs (seq) on delete cascade,
    key         text    not null,
    type        text    not null,
    options     text    not null,
    -- Stays with its job. What is not kept is a cache: it may go, and is made again when it is asked for.
    kept        integer not null,
    -- Made in a moment: need not wait behind what takes long.
    quick       integer not null,
    -- 0 where a client has asked, 1 where a job did beforehand: nobody waits for that.
    rank        integer not null,
    state       text    not null check (state in ('queued', 'running', 'succeeded', 'failed')),
    attempt     integer not null default 1,
    -- Counts the changes a client can see; the ETag.
    version     integer not null default 1,
    progress    text,
    path        text unique,
    bytes       integer,
    sha256      text,
    report      text,
    error       text,
    created_at  integer not null,
    started_at  integer,
    finished_at integer,
    updated_at  integer not null,
    -- When a client last asked for it.
    used_at     integer not null
) strict;

create unique index derived_by_key on derived (job, key);
create index derived_by_job on derived (job, seq);
-- The next one to make is the first entry of this index.
create index derived_queue on derived (rank, seq) where state = 'queued';
create index derived_quick on derived (rank, seq) where state = 'queued' and quick;
create index derived_running on derived (seq) where state = 'running';
create index derived_cache on derived (used_at) where not kept and path is not null;

-- How many are in each state, and what the cache holds: bounds and metrics ask for it all the time.
create table derived_counts (
    state       text    primary key,
    derived     integer not null,
    cache_bytes integer not null default 0
) strict, without rowid;

insert into derived_counts (state, derived) values ('queued', 0), ('running', 0), ('succeeded', 0), ('failed', 0);

create trigger derived_counts_insert after insert on derived
begin
    update derived_counts set derived = derived + 1 where state = new.state;
end;

create trigger derived_counts_update after update of state, kept, path on derived
begin
    update derived_counts set derived = derived - 1, cache_bytes = cache_bytes - iif(old.kept, 0, coalesce(old.bytes, 0))
    where state = old.state;
    update derived_counts set derived = derived + 1, cache_bytes = cache_bytes + iif(new.kept, 0, coalesce(new.bytes, 0))
    where state = new.state;
end;

create trigger derived_counts_delete after delete on derived
begin
    update derived_counts set derived = derived - 1, cache_bytes = cache_bytes - iif(old.kept, 0, coalesce(old.bytes, 0))
    where state = old.state;
end;

-- Jobs, what they ask for, and what they made.
--
-- Times are microseconds since the Unix epoch. `seq` is the order of acceptance: it pages listings
-- and breaks ties of priority, and AUTOINCREMENT keeps a cursor from ever meeting a reused number.
create table jobs (
    seq              integer primary key autoincrement,
    id               text    not null unique,
    state            text    not null check (state in ('queued', 'running', 'succeeded', 'failed', 'cancelled')),
    name             text,
    labels           text    not null,
    priority         integer not null,
    seed             integer not null,
    timeout_s        real,
    -- Attempt that runs or will run next; with `id` it is the fencing token of a lease.
    attempt          integer not null default 1,
    -- Last attempt that may start; a retry moves it on by `attempt_budget`.
    max_attempts     integer not null,
    attempt_budget   integer not null,
    cancel_requested integer not null default 0,
    -- Counts the changes a client can see; the ETag and the event id of the job.
    version          integer not null default 1,
    created_at       integer not null,
    started_at       integer,
    finished_at      integer,
    updated_at       integer not null,
    expires_at       integer,
    lease_expires_at integer,
    engine           text    not null,
    progress         text,
    error            text
) strict;

create index jobs_by_state on jobs (state, seq);
-- The next job to run is the first entry of this index.
create index jobs_queue on jobs (priority desc, seq) where state = 'queued';
create index jobs_leases on jobs (lease_expires_at) where state = 'running';
create index jobs_expiry on jobs (expires_at) where expires_at is not null;

-- Requests may hold a million diameters; apart from the jobs they leave listings and claims small.
create table job_requests (
    job  integer primary key references jobs (seq) on delete cascade,
    body text    not null
) strict;

-- Labels carry the state of their job, so that a filter by both never walks through jobs it drops.
create table job_labels (
    key   text    not null,
    value text    not null,
    job   integer not null references jobs (seq) on delete cascade,
    state text    not null,
    primary key (key, value, job)
) strict, without rowid;

create index job_labels_by_state on job_labels (key, value, state, job);
create index job_labels_by_job on job_labels (job);

create trigger job_labels_follow_state after update of state on jobs when new.state <> old.state
begin
    update job_labels set state = new.state where job = new.seq;
end;

-- How many jobs are in each state: the bound of the queue and the metrics ask for it all the time.
create table job_counts (
    state text    primary key,
    jobs  integer not null
) strict, without rowid;

insert into job_counts (state, jobs)
values ('queued', 0), ('running', 0), ('succeeded', 0), ('failed', 0), ('cancelled', 0);

create trigger job_counts_insert after insert on jobs
begin
    update job_counts set jobs = jobs + 1 where state = new.state;
end;

create trigger job_counts_update after update of state on jobs when new.state <> old.state
begin
    update job_counts set jobs = jobs - 1 where state = old.state;
    update job_counts set jobs = jobs + 1 where state = new.state;
end;

create trigger job_counts_delete after delete on jobs
begin
    update job_counts set jobs = jobs - 1 where state = old.state;
end;

-- The stored result of a job that succeeded; `path` is relative to the artifacts' folder.
create table artifacts (
    job             integer primary key references jobs (seq) on delete cascade,
    attempt         integer not null,
    path            text    not null unique,
    bytes           integer not null,
    sha256          text    not null,
    report          text    not null,
    -- Length in bytes of every format, as of this revision of the formats.
    format_revision integer not null,
    format_lengths  text    not null
) strict;

-- A key belongs to whoever used it and lives as long as its job.
create table idempotency_keys (
    scope       text    not null,
    key         text    not null,
    body_sha256 text    not null,
    job         integer not null references jobs (seq) on delete cascade,
    primary key (scope, key)
) strict, without rowid;

create index idempotency_keys_by_job on idempotency_keys (job);

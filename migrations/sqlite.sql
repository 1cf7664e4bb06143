-- The tables of Packstone in SQLite: one text, made at once in an empty file. `postgres.sql` has the same tables,
-- columns, keys, indices and triggers, under the same names.
--
-- Nothing is released yet: a change of the tables is made in both texts, and raises the number of the schema
-- (`SCHEMA` in server/src/jobs/store/schema.rs). From the first release on, each change is a migration besides.
--
-- Times are microseconds since the Unix epoch. Documents are JSON that the program writes and reads as text. Triggers
-- keep counts and sums, and record what must not be forgotten when a job changes its state, whatever statement changes
-- it.
--
-- Free pages are given back to the file system in small steps (`auto_vacuum = incremental`, which the program sets
-- before it makes the tables).

-- The database itself: one row.
create table packstone (
    -- Identity: random, made with the tables. A backup has the same one, and `packstone migrate-store` copies it.
    id         text    primary key,
    -- Counts the changes of these tables. A program refuses a database whose number it does not know.
    schema     integer not null,
    -- Version of Packstone that made the tables.
    version    text    not null,
    created_at integer not null,
    -- The run of the service that has the file open: random, made at its start, empty in a backup. What overwrites the
    -- file while it is open has another one.
    run        text    not null default '',
    -- Counts the transactions that have written. A file that is rolled back to an earlier state has a smaller number
    -- than the service has committed.
    commits    integer not null default 0
) strict, without rowid;

-- Studies: many jobs from one request.

-- Counts follow the jobs by trigger; a job that is deleted stays counted, as its run stays in `study_runs`.
create table studies (
    -- The order of acceptance: it pages listings.
    seq          integer primary key autoincrement,
    id           text    not null unique,
    name         text,
    labels       text    not null,
    seed         integer not null,
    -- JSON pointers that distinguish the points; empty for a list of jobs.
    columns      text    not null,
    -- Names of the first columns of the table of results.
    key_columns  text    not null,
    points       integer not null,
    replicates   integer not null,
    stop_when    text    not null,
    -- Jobs in each state.
    queued       integer not null,
    running      integer not null default 0,
    succeeded    integer not null default 0,
    failed       integer not null default 0,
    cancelled    integer not null default 0,
    -- Runs that say something about their mix, and the time they took: the time that is left is estimated from it.
    runs         integer not null default 0,
    runs_time_s  real    not null default 0,
    -- Counts the changes a client can see; the ETag of the study.
    version      integer not null default 1,
    created_at   integer not null,
    -- When no job was left to run; empty again after a retry.
    finished_at  integer,
    updated_at   integer not null,
    expires_at   integer,
    -- Name of the API key that submitted it; empty where the server required none.
    submitted_by text    not null default '',
    -- Owner; several keys may have one owner. Empty where the server required no key.
    owner        text    not null default '',
    -- Others can read it; the jobs of a shared study are shared too.
    shared       integer not null default 0,
    -- Bytes that its request takes with the parts that its jobs share.
    request_bytes integer not null default 0,
    -- The text of a row that has ended, the same as it was stored, and whether both are equal: a bit of a page that
    -- has changed is found where the row is read.
    row_text text generated always as (case when finished_at is not null then
        format(
            '%Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q',
            id, name, labels, seed, columns, key_columns, points, replicates, stop_when, queued, running, succeeded,
            failed, cancelled, runs, quote(runs_time_s), version, created_at, finished_at, updated_at, expires_at,
            submitted_by, owner, shared, request_bytes
        )
    end) virtual,
    row_copy text generated always as (row_text) stored,
    is_whole integer generated always as (row_copy is row_text) virtual
) strict;

create index studies_open on studies (seq) where finished_at is null;
create index studies_finished on studies (seq) where finished_at is not null;
create index studies_expiry on studies (expires_at) where expires_at is not null;

-- The longest lists in the requests of a study and of its jobs, each once: they may have a million diameters.
create table study_parts (
    study integer not null references studies (seq) on delete cascade,
    part  integer not null,
    body  text    not null,
    primary key (study, part)
) strict, without rowid;

-- Requests apart from the studies leave listings small. `body` is the text of the request without its part; `part_at`
-- characters of it come before the part. The digest is that of the whole text.
create table study_requests (
    study   integer primary key references studies (seq) on delete cascade,
    body    text    not null,
    part    integer,
    part_at integer,
    digest  integer not null
) strict;

create table study_labels (
    key   text    not null,
    value text    not null,
    study integer not null references studies (seq) on delete cascade,
    primary key (key, value, study)
) strict, without rowid;

create index study_labels_by_study on study_labels (study);

create table study_points (
    study         integer not null references studies (seq) on delete cascade,
    point         integer not null,
    -- Values of the first columns of the table of results.
    key_values    text    not null,
    -- Jobs that the stop rule has cancelled.
    stopped_early integer not null default 0,
    -- The text of the row, the same as it was stored, and whether both are equal: a bit of a page that has changed is
    -- found where the row is read.
    row_text text generated always as (
        format(
            '%Q %Q %Q %Q',
            study, point, key_values, stopped_early
        )
    ) virtual,
    row_copy text generated always as (row_text) stored,
    is_whole integer generated always as (row_copy is row_text) virtual,
    primary key (study, point)
) strict, without rowid;

-- One row for every job of a study that has run or was cancelled by a client; it outlives the job. Together with the
-- points it is all that the table of results needs.
create table study_runs (
    study     integer not null references studies (seq) on delete cascade,
    point     integer not null,
    replicate integer not null,
    outcome   text    not null check (outcome in ('succeeded', 'partial', 'not_reached', 'void')),
    facts     text    not null,
    ended_at  integer not null,
    -- The text of the row, the same as it was stored, and whether both are equal: a bit of a page that has changed is
    -- found where the row is read.
    row_text text generated always as (
        format(
            '%Q %Q %Q %Q %Q %Q',
            study, point, replicate, outcome, facts, ended_at
        )
    ) virtual,
    row_copy text generated always as (row_text) stored,
    is_whole integer generated always as (row_copy is row_text) virtual,
    primary key (study, point, replicate)
) strict, without rowid;

-- A key belongs to the owner that used it and lives as long as its study.
create table study_keys (
    scope       text    not null,
    key         text    not null,
    body_sha256 text    not null,
    study       integer not null references studies (seq) on delete cascade,
    primary key (scope, key)
) strict, without rowid;

create index study_keys_by_study on study_keys (study);

-- Jobs, with their requests and results.

-- The columns that triggers name are among the first 32. For a trigger that names a later one, SQLite computes every
-- column of the old row at each change, the generated ones too: a deletion took 1.4 times as long.
create table jobs (
    -- The order of acceptance: it pages listings and breaks ties of priority. No number is used twice, so that a cursor
    -- of a listing never meets another job in place of one that was deleted.
    seq              integer primary key autoincrement,
    id               text    not null unique,
    state            text    not null
        check (state in ('queued', 'running', 'succeeded', 'failed', 'cancelled')),
    name             text,
    labels           text    not null,
    priority         integer not null,
    -- All 64 bits of the seed, of which this is the two's complement.
    seed             integer not null,
    timeout_s        real,
    -- Attempt that runs or will run next; with `id` it is the fencing token of a lease.
    attempt          integer not null default 1,
    -- Last attempt that may start; a retry raises it by `attempt_budget`.
    max_attempts     integer not null,
    attempt_budget   integer not null,
    -- A client wants the job to end. A job that is cancelled without this was cancelled by the stop rule of its study.
    cancel_requested integer not null default 0,
    -- A client wants the run to end with the packing that it has reached.
    finish_requested integer not null default 0,
    -- Counts the changes a client can see; the ETag and the event ID of the job.
    version          integer not null default 1,
    created_at       integer not null,
    started_at       integer,
    finished_at      integer,
    updated_at       integer not null,
    expires_at       integer,
    lease_expires_at integer,
    engine           text    not null,
    progress         text,
    -- What ended the job: code, detail, faulty fields, figures. The interface makes a problem document of it.
    error            text,
    study            integer references studies (seq) on delete cascade,
    point            integer,
    replicate        integer,
    -- Virtual start time: the place in the queue among jobs of the same owner and priority (see turns.rs).
    turn             integer not null default 0,
    -- Time that the plan expects the job to take on one core, in microseconds; a minute where the plan tells none (see
    -- forecasts.rs).
    forecast_us      integer not null default 60000000,
    -- Bytes that its request takes, without the part that it shares with other jobs of its study.
    request_bytes    integer not null default 0,
    -- Owner; several keys may have one owner. Empty where the server required no key.
    owner            text    not null default '',
    -- A job that met a fault of the machine starts no sooner than this.
    not_before       integer,
    -- Why it starts no sooner, as JSON: what it waits for, and a sentence.
    waits_for        text,
    -- Faults of the machine since the last run that met none; the pause grows with them.
    faults           integer not null default 0,
    -- The method that the request names, or 'auto', so that a listing can filter by it without reading requests.
    method           text,
    -- What the plan of the request warns of, as a JSON list of sentences. A finished job shows the warnings of its
    -- result instead.
    warnings         text    not null default '[]',
    -- Name of the API key that submitted it; empty where the server required none.
    submitted_by     text    not null default '',
    -- Others can read it.
    shared           integer not null default 0,
    -- Name of the process that runs the job, or ran it last; empty for a worker of the server itself.
    worker           text    not null default '',
    -- Name of the API key by which it was leased; only requests with this key may renew or end the lease.
    worker_key       text    not null default '',
    -- ID of the request that leased the job: a repeated one gets the same job again.
    claim            text,
    -- When a worker process sent the end of the attempt, a result in `artifacts` or a failure in `error`, that is not
    -- checked yet.
    received_at      integer,
    -- The least time that a worker must have left to be given the job, in microseconds (see forecasts.rs).
    least_time_us    integer not null default 0,
    -- Most threads that may compute the packing, as the request has it.
    threads          integer,
    -- Most threads that the packing has work for, by its plan at submission.
    most_threads     integer not null default 1,
    -- What the request packs, in a few words, as JSON: lists show it.
    overview         text,
    -- Its line that stands for the name of a job without one: lists are searched for it.
    title            text generated always as (overview ->> '$.title') virtual,
    -- The text of a row that has ended, the same as it was stored, and whether both are equal: a bit of a page that
    -- has changed is found where the row is read.
    row_text text generated always as (case when finished_at is not null then
        format(
            '%Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q '
            || '%Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q',
            id, state, name, labels, priority, seed, quote(timeout_s), attempt, max_attempts, attempt_budget,
            cancel_requested, finish_requested, version, created_at, started_at, finished_at, updated_at, expires_at,
            lease_expires_at, engine, progress, error, study, point, replicate, turn, not_before, waits_for, faults,
            owner, method, warnings, submitted_by, shared, worker, worker_key, claim, received_at, forecast_us,
            least_time_us, threads, most_threads, request_bytes, overview
        )
    end) virtual,
    row_copy text generated always as (row_text) stored,
    is_whole integer generated always as (row_copy is row_text) virtual
) strict;

create index jobs_by_state on jobs (state, seq);
-- The next job of an owner is the first record of the owner in this index.
create index jobs_queue on jobs (owner, priority desc, turn, seq) where state = 'queued';
create index jobs_leases on jobs (lease_expires_at) where state = 'running';
create index jobs_expiry on jobs (expires_at) where expires_at is not null;
-- Waiting jobs that are cancelled when they expire.
create index jobs_expiry_queued on jobs (expires_at) where state = 'queued' and expires_at is not null;
create index jobs_by_study on jobs (study, seq) where study is not null;
create index jobs_by_study_state on jobs (study, state, seq) where study is not null;
create unique index jobs_by_point on jobs (study, point, replicate) where study is not null;
create index jobs_by_method on jobs (method, seq);
-- Orders of listings besides that of submission. A job that has not ended comes before all that have.
create index jobs_by_priority on jobs (priority, seq);
create index jobs_by_finished on jobs (coalesce(finished_at, 0), seq);
-- The listings of one owner walk these two indices, in the order of submission.
create index jobs_by_owner on jobs (owner, seq);
create index jobs_shared on jobs (seq) where shared;
create index jobs_claims on jobs (claim) where claim is not null;
-- Those whose end is to be checked.
create index jobs_received on jobs (received_at) where received_at is not null;
-- Those whose lease is renewed from outside, at the start of the server.
create index jobs_of_workers on jobs (worker) where worker <> '' and state = 'running';

-- Requests apart from the jobs leave listings and claims small. The columns are those of `study_requests`; the part is
-- one of the study of the job.
create table job_requests (
    job     integer primary key references jobs (seq) on delete cascade,
    body    text    not null,
    part    integer,
    part_at integer,
    digest  integer not null
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

-- A key belongs to the owner that used it and lives as long as its job.
create table idempotency_keys (
    scope       text    not null,
    key         text    not null,
    body_sha256 text    not null,
    job         integer not null references jobs (seq) on delete cascade,
    primary key (scope, key)
) strict, without rowid;

create index idempotency_keys_by_job on idempotency_keys (job);

-- How many jobs are in each state: the bound of the queue and the metrics read it all the time.
create table job_counts (
    state       text    primary key,
    jobs        integer not null,
    -- Sum of the forecasts of the jobs that wait and run; 0 in the other states.
    forecast_us integer not null default 0
) strict, without rowid;

insert into job_counts (state, jobs)
values ('queued', 0), ('running', 0), ('succeeded', 0), ('failed', 0), ('cancelled', 0);

-- Fair queueing (see turns.rs): a worker first chooses the owner whose turn it is, then the job of that owner.

-- Jobs that wait and run, and bytes of requests, by owner.
create table queue_owners (
    owner      text    primary key,
    queued     integer not null default 0,
    running    integer not null default 0,
    -- Virtual start time of the owner's job that started last.
    last_start integer not null default -1,
    -- Bytes of the requests of all jobs and studies of the owner.
    request_bytes integer not null default 0
) strict, without rowid;

-- The turn of the job that started last, for each owner and priority.
create table queue_starts (
    owner    text    not null,
    priority integer not null,
    turn     integer not null,
    primary key (owner, priority)
) strict, without rowid;

-- The last turn that was given out in each flow. A flow is a study; flow 0 is all single jobs of an owner.
create table queue_owner_flows (
    owner     text    not null,
    flow      integer not null,
    priority  integer not null,
    last_turn integer not null,
    primary key (owner, flow, priority)
) strict, without rowid;

-- The stored result of a job that succeeded.
create table artifacts (
    job             integer primary key references jobs (seq) on delete cascade,
    attempt         integer not null,
    -- Relative to the folder of artifacts.
    path            text    not null unique,
    bytes           integer not null,
    sha256          text    not null,
    report          text    not null,
    -- Tells that the report is the one that was stored.
    report_digest   integer not null,
    -- Length in bytes of every format, as of this revision of the formats.
    format_revision integer not null,
    format_lengths  text    not null,
    -- The owner of the job: the row may be deleted after that of its job.
    owner           text    not null default '',
    -- The text of the row, the same as it was stored, and whether both are equal: a bit of a page that has changed is
    -- found where the row is read. The report has a digest.
    row_text text generated always as (
        format(
            '%Q %Q %Q %Q %Q %Q %Q %Q',
            attempt, path, bytes, sha256, report_digest, format_revision, format_lengths, owner
        )
    ) virtual,
    row_copy text generated always as (row_text) stored,
    is_whole integer generated always as (row_copy is row_text) virtual
) strict;

-- Exports of finished packings: meshes, voxels, slices, lattice models. One row for each export of a job's result that
-- was requested; its file lies in the folder of artifacts.
create table exports (
    seq              integer primary key autoincrement,
    id               text    not null unique,
    job              integer not null references jobs (seq) on delete cascade,
    -- Names result, options and revision, so that the same thing is made once.
    key              text    not null,
    type             text    not null,
    options          text    not null,
    -- Stays with its job. An export that is not kept is a cache: it may be removed, and is made again on request.
    kept             integer not null,
    -- Made in a moment: need not wait behind long ones.
    quick            integer not null,
    -- Takes as long as a packing, and the request of the job asked for it: made in the slots of packings.
    heavy            integer not null default 0,
    -- Needs Gmsh, which not every process has.
    needs_mesher     integer not null default 0,
    -- 0 where a client requested it, 1 where the request of the job did: no client waits for that.
    rank             integer not null,
    state            text    not null check (state in ('queued', 'running', 'succeeded', 'failed')),
    attempt          integer not null default 1,
    -- Counts the changes a client can see; the ETag.
    version          integer not null default 1,
    progress         text,
    -- Relative to the folder of artifacts; empty while there is no file.
    path             text    unique,
    bytes            integer,
    sha256           text,
    report           text,
    -- Why it was not made: code, detail, faulty fields.
    error            text,
    created_at       integer not null,
    started_at       integer,
    finished_at      integer,
    updated_at       integer not null,
    -- When a client last requested it.
    used_at          integer not null,
    -- An export that met a fault of the machine starts no sooner than this.
    not_before       integer,
    -- Faults of the machine since the last run that met none; the pause grows with them.
    faults           integer not null default 0,
    -- The owner of the job: the row may be deleted after that of its job.
    owner            text    not null default '',
    -- Until when the attempt that runs has it, unless it renews.
    lease_expires_at integer,
    -- The last attempt that a stop of the server may end: one that does not count raises it, so that no two runs have
    -- the same number.
    max_attempts     integer not null default 3,
    -- Name of the worker process that makes or made it, and of its API key; empty for this server's own.
    worker           text    not null default '',
    worker_key       text    not null default '',
    -- ID of the request of that process.
    claim            text,
    -- The text of a row that has ended, the same as it was stored, and whether both are equal: a bit of a page that
    -- has changed is found where the row is read.
    row_text text generated always as (case when finished_at is not null then
        format(
            '%Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q %Q',
            id, job, key, type, options, kept, quick, heavy, needs_mesher, rank, state, attempt, version, progress,
            path, bytes, sha256, report, error, created_at, started_at, finished_at, updated_at, used_at, not_before,
            faults, owner, lease_expires_at, max_attempts, worker, worker_key, claim
        )
    end) virtual,
    row_copy text generated always as (row_text) stored,
    is_whole integer generated always as (row_copy is row_text) virtual
) strict;

create unique index exports_by_key on exports (job, key);
create index exports_by_job on exports (job, seq);
-- The next export to make is the first record of this index; of those that are made in the slots of packings, of the
-- index after it.
create index exports_queue on exports (rank, seq) where state = 'queued' and not heavy;
create index exports_heavy on exports (rank, seq) where state = 'queued' and heavy;
create index exports_quick on exports (rank, seq) where state = 'queued' and quick;
create index exports_running on exports (seq) where state = 'running';
create index exports_leases on exports (lease_expires_at) where state = 'running';
create index exports_cache on exports (used_at) where not kept and path is not null;

-- How many exports are in each state, and what the cache holds: bounds and metrics read it all the time.
create table export_counts (
    state       text    primary key,
    exports     integer not null,
    cache_bytes integer not null default 0
) strict, without rowid;

insert into export_counts (state, exports) values ('queued', 0), ('running', 0), ('succeeded', 0), ('failed', 0);

-- Wrong results that worker processes have sent since an administrator last allowed them.
create table wrong_results (
    seq        integer primary key,
    -- Name of the API key of the worker process.
    worker_key text    not null,
    worker     text    not null,
    -- ID of the job and number of the attempt.
    job        text    not null,
    attempt    integer not null,
    fault      text    not null,
    at         integer not null
) strict;

create index wrong_results_by_worker on wrong_results (worker_key, worker);
create index wrong_results_by_job on wrong_results (job);

-- Files that a committed deletion leaves behind. The sweeper removes these and no others: it moves what the database
-- does not know to the quarantine.
create table removals (
    path text primary key
) strict, without rowid;

-- Bytes of files by owner and by what they are: quotas and metrics read it at every submission.
create table stored_bytes (
    owner text    not null,
    kind  text    not null check (kind in ('results', 'exports', 'cache')),
    bytes integer not null,
    primary key (owner, kind)
) strict, without rowid;

insert into stored_bytes (owner, kind, bytes) values ('', 'results', 0), ('', 'exports', 0), ('', 'cache', 0);

-- Webhooks: where to send a message when a job ends or a study finishes, and what became of each message.

-- The job or the study that names the URL. Requests and results do not contain the URL, because it may contain a token.
create table webhooks (
    seq   integer primary key,
    job   integer unique references jobs (seq) on delete cascade,
    study integer unique references studies (seq) on delete cascade,
    url   text    not null,
    -- Host of the URL: one message at a time is sent to it. Both are empty where the webhook was removed.
    host  text    not null,
    check ((job is null) <> (study is null))
) strict;

create table webhook_deliveries (
    seq          integer primary key autoincrement,
    webhook      integer not null references webhooks (seq) on delete cascade,
    -- The header `webhook-id`: the same in all attempts, so that a receiver can drop repeats.
    id           text    not null unique,
    body         text    not null,
    -- Owner of the job or the study: owners take turns (see webhooks/on_the_way.rs).
    owner        text    not null default '',
    host         text    not null,
    state        text    not null check (state in ('waiting', 'delivered', 'failed')),
    attempts     integer not null default 0,
    sent_before  integer not null generated always as (attempts > 0),
    -- The next attempt is not made before this time.
    next_at      integer not null,
    -- The last attempt: what was wrong, and the HTTP status where there was an answer.
    last_error   text,
    last_status  integer,
    created_at   integer not null,
    delivered_at integer,
    -- The URL that the webhook had when the message was recorded.
    url          text    not null default ''
) strict;

-- The next message of an owner to a host is the first record of both in this index.
create index webhook_deliveries_waiting on webhook_deliveries (owner, host, sent_before, next_at, seq)
    where state = 'waiting';
create index webhook_deliveries_by_webhook on webhook_deliveries (webhook, seq);

-- Triggers of jobs.

create trigger job_counts_insert after insert on jobs
begin
    update job_counts set
        jobs = jobs + 1, forecast_us = forecast_us + iif(state in ('queued', 'running'), new.forecast_us, 0)
    where state = new.state;
end;

create trigger job_counts_update after update of state on jobs when new.state <> old.state
begin
    update job_counts set
        jobs = jobs - 1, forecast_us = forecast_us - iif(state in ('queued', 'running'), old.forecast_us, 0)
    where state = old.state;
    update job_counts set
        jobs = jobs + 1, forecast_us = forecast_us + iif(state in ('queued', 'running'), new.forecast_us, 0)
    where state = new.state;
end;

create trigger job_counts_delete after delete on jobs
begin
    update job_counts set
        jobs = jobs - 1, forecast_us = forecast_us - iif(state in ('queued', 'running'), old.forecast_us, 0)
    where state = old.state;
end;

-- A job without labels has none to look for.
create trigger job_labels_follow_state after update of state on jobs
when new.state <> old.state and new.labels <> '{}'
begin
    update job_labels set state = new.state where job = new.seq;
end;

create trigger queue_owners_insert after insert on jobs
begin
    insert into queue_owners (owner, queued, running, request_bytes)
    values (new.owner, new.state = 'queued', new.state = 'running', new.request_bytes)
    on conflict (owner) do update set
        queued = queued + excluded.queued, running = running + excluded.running,
        request_bytes = request_bytes + excluded.request_bytes;
end;

-- A job that starts takes the turn of its owner here: one statement less at every start.
create trigger queue_owners_update after update of state on jobs
when new.state <> old.state and (new.state in ('queued', 'running') or old.state in ('queued', 'running'))
begin
    update queue_owners set
        queued = queued + (new.state = 'queued') - (old.state = 'queued'),
        running = running + (new.state = 'running') - (old.state = 'running'),
        last_start = iif(
            new.state = 'running', max(last_start + 1, (select max(last_start) from queue_owners)), last_start
        )
    where owner = new.owner;
end;

create trigger queue_owners_delete after delete on jobs
begin
    update queue_owners set
        queued = queued - (old.state = 'queued'), running = running - (old.state = 'running'),
        request_bytes = request_bytes - old.request_bytes
    where owner = old.owner;
end;

-- A job that starts advances the virtual time of its owner and priority (see turns.rs) by trigger: one statement less
-- at every start.
create trigger queue_starts_update after update of state on jobs
when old.state = 'queued' and new.state = 'running'
begin
    insert into queue_starts (owner, priority, turn) values (new.owner, new.priority, new.turn)
    on conflict (owner, priority) do update set
        turn = case when excluded.turn > queue_starts.turn then excluded.turn else queue_starts.turn end;
end;

create trigger study_counts_update after update of state on jobs
when new.study is not null and new.state <> old.state
begin
    update studies set
        queued = queued + (new.state = 'queued') - (old.state = 'queued'),
        running = running + (new.state = 'running') - (old.state = 'running'),
        succeeded = succeeded + (new.state = 'succeeded') - (old.state = 'succeeded'),
        failed = failed + (new.state = 'failed') - (old.state = 'failed'),
        cancelled = cancelled + (new.state = 'cancelled') - (old.state = 'cancelled'),
        finished_at = iif(
            queued + running + (new.state in ('queued', 'running')) - (old.state in ('queued', 'running')) = 0,
            new.updated_at, null
        ),
        version = version + 1,
        updated_at = new.updated_at
    where seq = new.study;
end;

-- An end that says nothing about the mix. A statement that knows more replaces the row in the same transaction. Where a
-- client has cancelled, `cancel_requested` is set; without it the job was cancelled by the stop rule, and has not run.
create trigger study_runs_void after update of state on jobs
when new.study is not null and old.state in ('queued', 'running')
    and (new.state = 'failed' or (new.state = 'cancelled' and new.cancel_requested))
begin
    insert or replace into study_runs (study, point, replicate, outcome, facts, ended_at)
    values (
        new.study, new.point, new.replicate, 'void',
        json_object('time_s', (new.finished_at - coalesce(new.started_at, new.finished_at)) / 1e6), new.finished_at
    );
end;

create trigger study_points_stopped after update of state on jobs
when new.study is not null and old.state = 'queued' and new.state = 'cancelled' and not new.cancel_requested
begin
    update study_points set stopped_early = stopped_early + 1 where study = new.study and point = new.point;
end;

-- A job that is retried has not run.
create trigger study_runs_retried after update of state on jobs
when new.study is not null and new.state = 'queued' and old.state in ('failed', 'cancelled')
begin
    delete from study_runs where study = new.study and point = new.point and replicate = new.replicate;
    update study_points set stopped_early = stopped_early - 1
    where study = new.study and point = new.point and old.state = 'cancelled' and not old.cancel_requested;
end;

-- The end of a job records its message in the same transaction, whatever statement ends it. The jobs of a study have no
-- webhook.
create trigger webhook_of_job after update of state on jobs
when new.state in ('succeeded', 'failed', 'cancelled') and old.state in ('queued', 'running') and new.study is null
begin
    insert into webhook_deliveries (webhook, id, body, url, owner, host, state, next_at, created_at)
    select
        webhooks.seq,
        'msg_' || lower(hex(randomblob(16))),
        json_object(
            'type', 'job.' || new.state,
            'timestamp', strftime('%Y-%m-%dT%H:%M:%S', new.finished_at / 1000000, 'unixepoch')
                || printf('.%06dZ', new.finished_at % 1000000),
            'data', json_patch(
                json_object(
                    'id', new.id, 'name', new.name, 'labels', json(new.labels), 'state', new.state,
                    'links', json_object('self', '/v1/jobs/' || new.id)
                ),
                iif(
                    new.state = 'failed',
                    json_object(
                        'error', json_object('code', new.error ->> '$.code', 'detail', new.error ->> '$.detail')
                    ),
                    '{}'
                )
            )
        ),
        webhooks.url, new.owner, webhooks.host, 'waiting', new.finished_at, new.finished_at
    from webhooks where webhooks.job = new.seq and webhooks.url <> '';
end;

-- Triggers of studies.

create trigger webhook_of_study after update of finished_at on studies
when new.finished_at is not null and old.finished_at is null
begin
    insert into webhook_deliveries (webhook, id, body, url, owner, host, state, next_at, created_at)
    select
        webhooks.seq,
        'msg_' || lower(hex(randomblob(16))),
        json_object(
            'type', 'study.finished',
            'timestamp', strftime('%Y-%m-%dT%H:%M:%S', new.finished_at / 1000000, 'unixepoch')
                || printf('.%06dZ', new.finished_at % 1000000),
            'data', json_object(
                'id', new.id, 'name', new.name, 'labels', json(new.labels), 'state', 'finished',
                'counts', json_object(
                    'succeeded', new.succeeded, 'failed', new.failed, 'cancelled', new.cancelled
                ),
                'links', json_object('self', '/v1/studies/' || new.id)
            )
        ),
        webhooks.url, new.owner, webhooks.host, 'waiting', new.finished_at, new.finished_at
    from webhooks where webhooks.study = new.seq and webhooks.url <> '';
end;

create trigger queue_owners_study_insert after insert on studies
begin
    insert into queue_owners (owner, request_bytes) values (new.owner, new.request_bytes)
    on conflict (owner) do update set request_bytes = request_bytes + excluded.request_bytes;
end;

create trigger queue_owners_study_delete after delete on studies
begin
    update queue_owners set request_bytes = request_bytes - old.request_bytes where owner = old.owner;
end;

create trigger queue_owner_flows_end after delete on studies
begin
    delete from queue_owner_flows where owner = old.owner and flow = old.seq;
end;

-- Triggers of results.

create trigger removals_of_artifacts after delete on artifacts
begin
    insert or ignore into removals (path) values (old.path);
end;

create trigger stored_bytes_artifact_insert after insert on artifacts
begin
    insert into stored_bytes (owner, kind, bytes) values (new.owner, 'results', new.bytes)
    on conflict (owner, kind) do update set bytes = bytes + excluded.bytes;
end;

create trigger stored_bytes_artifact_delete after delete on artifacts
begin
    update stored_bytes set bytes = bytes - old.bytes where owner = old.owner and kind = 'results';
end;

-- Triggers of exports.

create trigger export_counts_insert after insert on exports
begin
    update export_counts set exports = exports + 1 where state = new.state;
end;

create trigger export_counts_update after update of state, kept, path on exports
begin
    update export_counts set exports = exports - 1, cache_bytes = cache_bytes - iif(old.kept, 0, coalesce(old.bytes, 0))
    where state = old.state;
    update export_counts set exports = exports + 1, cache_bytes = cache_bytes + iif(new.kept, 0, coalesce(new.bytes, 0))
    where state = new.state;
end;

create trigger export_counts_delete after delete on exports
begin
    update export_counts set exports = exports - 1, cache_bytes = cache_bytes - iif(old.kept, 0, coalesce(old.bytes, 0))
    where state = old.state;
end;

create trigger removals_of_deleted_exports after delete on exports when old.path is not null
begin
    insert or ignore into removals (path) values (old.path);
end;

create trigger removals_of_requeued_exports after update of path on exports
when old.path is not null and new.path is not old.path
begin
    insert or ignore into removals (path) values (old.path);
end;

create trigger stored_bytes_export_update after update of kept, path, bytes on exports
begin
    update stored_bytes set bytes = bytes - old.bytes
    where old.path is not null and owner = old.owner and kind = iif(old.kept, 'exports', 'cache');
    insert into stored_bytes (owner, kind, bytes)
    select new.owner, iif(new.kept, 'exports', 'cache'), new.bytes where new.path is not null
    on conflict (owner, kind) do update set bytes = bytes + excluded.bytes;
end;

create trigger stored_bytes_export_delete after delete on exports when old.path is not null
begin
    update stored_bytes set bytes = bytes - old.bytes
    where owner = old.owner and kind = iif(old.kept, 'exports', 'cache');
end;

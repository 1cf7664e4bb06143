-- A job that starts advances the virtual time of its owner and priority (see turns.rs) by trigger: one statement less
-- at every start.
create function queue_starts_update() returns trigger language plpgsql as $$
begin
    insert into queue_starts (owner, priority, turn) values (new.owner, new.priority, new.turn)
    on conflict (owner, priority) do update set turn = greatest(excluded.turn, queue_starts.turn);
    return null;
end
$$;

create trigger queue_starts_update after update of state on jobs for each row
when (old.state = 'queued' and new.state = 'running') execute function queue_starts_update();

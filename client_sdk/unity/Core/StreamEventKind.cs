namespace Terraport
{
    /// <summary>What a <see cref="StreamEvent"/> tells.</summary>
    public enum StreamEventKind
    {
        /// <summary>The connection changed: <see cref="StreamEvent.Link"/>.</summary>
        Link,

        /// <summary>The scene is open: version, session, whether the version is another one than before.</summary>
        Opened,

        /// <summary>The plan of a landing came: <see cref="StreamEvent.Plan"/>.</summary>
        Planned,

        /// <summary>A segment is whole and verified: <see cref="StreamEvent.Facts"/>; no landing for what an aim brought.</summary>
        Arrived,

        /// <summary>The deadline passed: <see cref="StreamEvent.Segments"/> may be shown before the rest.</summary>
        Degraded,

        /// <summary>Every byte is here: exactly <see cref="StreamEvent.Segments"/> are to be shown.</summary>
        Ready,

        /// <summary>A newer landing took its place: <see cref="StreamEvent.By"/>.</summary>
        Superseded,

        /// <summary>An aim is being fetched: <see cref="StreamEvent.Count"/> segments of <see cref="StreamEvent.Bytes"/>.</summary>
        Prefetching,

        /// <summary>An aim is whole.</summary>
        Prefetched,

        /// <summary>
        /// <see cref="StreamEvent.Segments"/> cannot be asked for any more: the cache let them go, or the version
        /// changed.
        /// </summary>
        Dropped,

        /// <summary>The server said no: code, message, whether the session is over, perhaps the landing.</summary>
        Refused,

        /// <summary>The server tells something: <see cref="StreamEvent.Notice"/>.</summary>
        Notice,

        /// <summary>A pick was answered: <see cref="StreamEvent.Hit"/>, or null where nothing was met.</summary>
        Picked,

        /// <summary>A pick was refused: code and message.</summary>
        PickRefused,

        /// <summary>The session has a seat in its group, or has it again after a reconnect: <see cref="StreamEvent.Group"/>.</summary>
        GroupJoined,

        /// <summary>Who is in the group: its members.</summary>
        GroupRoster,

        /// <summary>The guide lands the group: its gathering. Land there, or do not, and say so by Arrive.</summary>
        GroupCalled,

        /// <summary>The barrier of the gathering is open: who has arrived.</summary>
        GroupGathered,

        /// <summary>A join or gather was refused: request, code and message; no group where the seat is gone.</summary>
        GroupRefused,
    }
}

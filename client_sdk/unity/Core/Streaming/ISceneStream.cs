using System;

namespace Terraport
{
    /// <summary>
    /// A session with a server over all its connections: lands, aims, picks; receives, verifies and holds payloads.
    /// </summary>
    /// <remarks>
    /// Nothing here blocks. Commands, <see cref="TryNextEvent"/> and <see cref="Pump"/> belong to one thread, the one that
    /// made the stream; <see cref="TryPin"/> and the pins that it gives may be used from any. Events come in order and wait
    /// until they are taken.
    /// </remarks>
    public interface ISceneStream : IDisposable
    {
        /// <summary>What has been counted so far.</summary>
        StreamStats Stats { get; }

        /// <summary>Ask for a landing; it supersedes any that is not ready.</summary>
        /// <param name="position">Where, metres of the scene frame, each at most 10^7.</param>
        /// <param name="radiusM">Radius in metres, above 0, at most 10^6; servers set a smaller bound.</param>
        /// <param name="options">Ring, inner radius, deadline, stall; null for none. Not changed, and copied at once.</param>
        /// <returns>Its number in the events, from 1; it stays the same over reconnects.</returns>
        /// <exception cref="ArgumentException">A number that the protocol does not allow; nothing has changed.</exception>
        int Land(Vec3 position, double radiusM, LandOptions options = null);

        /// <summary>Tell where the user points; only the newest counts, sent at most ten times a second.</summary>
        /// <param name="position">Where, metres of the scene frame.</param>
        /// <param name="radiusM">As of the landing that may follow.</param>
        /// <param name="coarseRadiusM">As <see cref="LandOptions.CoarseRadiusM"/>; null for no ring.</param>
        /// <exception cref="ArgumentException">A number that the protocol does not allow; nothing has changed.</exception>
        void Aim(Vec3 position, double radiusM, double? coarseRadiusM = null);

        /// <summary>Ask what full detail has along a ray, or, without direction, above and below a point.</summary>
        /// <returns>
        /// The request's number in the events: one <see cref="StreamEventKind.Picked"/> or
        /// <see cref="StreamEventKind.PickRefused"/> follows.
        /// </returns>
        /// <exception cref="ArgumentException">A number that the protocol does not allow; nothing has changed.</exception>
        int Pick(Vec3 origin, Vec3? direction = null);

        /// <summary>
        /// Take a seat in a group of this scene; a seat held before is left. The connection is made anew, to where the group is;
        /// nothing that is held comes again. A lost connection takes the seat again by itself.
        /// </summary>
        /// <param name="group">1 to 64 of A-Z a-z 0-9 _ . ~ -.</param>
        /// <param name="role">The guide lands the group; there is one at most.</param>
        /// <param name="ownName">What the others see; null for none.</param>
        /// <returns>
        /// The request's number: one <see cref="StreamEventKind.GroupJoined"/> or <see cref="StreamEventKind.GroupRefused"/> follows.
        /// </returns>
        /// <exception cref="ArgumentException">A name that the protocol does not allow; nothing has changed.</exception>
        int JoinGroup(string group, GroupRole role, string ownName = null);

        /// <summary>Give the seat in the group up; nothing where there is none.</summary>
        void LeaveGroup();

        /// <summary>Land the group, as its guide, who is told of it like everybody: <see cref="StreamEventKind.GroupCalled"/>.</summary>
        /// <param name="position">Where, metres of the scene frame.</param>
        /// <param name="radiusM">Asked of everybody; each member's own bounds cut what it loads.</param>
        /// <param name="innerRadiusM">What may be shown where time is short; null for nothing.</param>
        /// <param name="deadlineMs">When nobody waits any longer; null takes the server's, which also bounds it.</param>
        /// <returns>The request's number, for <see cref="StreamEventKind.GroupRefused"/>.</returns>
        /// <exception cref="ArgumentException">A number that the protocol does not allow; nothing has changed.</exception>
        int Gather(Vec3 position, double radiusM, double? innerRadiusM = null, int? deadlineMs = null);

        /// <summary>
        /// Say how the own part of a group landing ended; <see cref="GroupFollower"/> does it by itself. Nothing where a newer one has come.
        /// </summary>
        /// <exception cref="ArgumentException">A number that the protocol does not allow; nothing has changed.</exception>
        void Arrive(uint gathering, GroupArrival how);

        /// <summary>Do everything that is due; call it once per frame. A stream with its own thread does nothing here.</summary>
        void Pump();

        /// <summary>Take the next event; false where none waits.</summary>
        bool TryNextEvent(out StreamEvent next);

        /// <summary>Take hold of a held segment's payload; false where it is not held (any more). Dispose what it gives.</summary>
        bool TryPin(uint segment, out PinnedPayload payload);

        /// <summary>
        /// Connect now: after <see cref="LinkPhase.Closed"/>, or to cut a wait short. Null keeps the token; another token makes
        /// a new connection in any case, with everything held, and stands for a <see cref="StreamOptions.TokenProvider"/> from now on.
        /// </summary>
        void Reconnect(string token = null);

        /// <summary>Say goodbye and free everything. The stream is of no use afterwards; pins stay valid.</summary>
        void Close();
    }
}

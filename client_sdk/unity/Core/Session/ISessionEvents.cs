using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>What a session reports, while it takes a message or a command. May call the session: its state is consistent then.</summary>
    internal interface ISessionEvents
    {
        /// <summary>The service has answered; <paramref name="isChanged"/> where it serves another version than before.</summary>
        void Opened(Welcome welcome, bool isChanged);

        /// <summary>A landing has its plan; one that is asked for again gets another.</summary>
        void Planned(Landing landing);

        /// <summary>All bytes of a segment are here: the owner decodes it and answers by Accept or Reject.</summary>
        void Arrived(ulong key, byte[] payload);

        /// <summary>A plan needs a segment from the disk: the owner reads and decodes it and answers by Accept or Lost.</summary>
        void RestoreNeeded(ulong key);

        /// <summary>The deadline has passed and the inner set is whole; the landing continues.</summary>
        void InnerWhole(Landing landing, List<PlanRow> rows);

        /// <summary>A landing is whole, except for segments that are not available.</summary>
        void Whole(Landing landing, List<PlanRow> rows, List<uint> missing);

        /// <summary>
        /// The service refused a landing (null: something else) or, where it is fatal, the connection; or a landing was given up here.
        /// </summary>
        void Refused(int? landing, string code, string message, bool isFatal);

        /// <summary>A pick was answered; a code says that it was refused.</summary>
        void Picked(int request, PickHit hit, string code);

        void Noticed(Notice notice);

        /// <summary>The group, its members or its gathering have changed.</summary>
        void GroupChanged(GroupChange change);

        /// <summary>The service refused to let the client join or gather.</summary>
        void GroupRefused(int request, string code, string message);
    }
}

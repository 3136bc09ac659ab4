using System;

namespace Terraport.Wire
{
    /// <summary>A value that its kind does not allow; never leaves this folder.</summary>
    internal sealed class RefusedException : Exception
    {
        /// <param name="text">What was received and what was expected.</param>
        /// <param name="path">Path below the field; empty for the field itself.</param>
        internal RefusedException(string text, string path = "") : base(text) { Path = path; }

        internal string Path { get; }

        /// <summary>The same error with <paramref name="outer"/> in front of its path: each level of nesting adds its name.</summary>
        internal RefusedException Below(string outer)
        {
            return new RefusedException(Message, Path.Length == 0 ? outer : outer + "." + Path);
        }
    }
}

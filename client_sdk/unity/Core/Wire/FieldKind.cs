using Terraport.Json;

namespace Terraport.Wire
{
    /// <summary>
    /// What a field may be. A message is read in three passes, as the Python side does it, so that both name the same field of
    /// a message with several faults: layout of every field, value of every field, rules between fields.
    /// </summary>
    internal abstract class FieldKind
    {
        /// <summary>First pass: what tables and nested maps hold; null for kinds whose layout is their value.</summary>
        /// <exception cref="RefusedException">It is laid out otherwise.</exception>
        internal virtual object Layout(JsonValue raw) { return null; }

        /// <summary>Second pass: the value, checked.</summary>
        /// <param name="raw">As received, not null.</param>
        /// <param name="layout">What <see cref="Layout"/> gave.</param>
        internal abstract object Read(JsonValue raw, object layout);

        /// <summary>Check a value that we are about to send.</summary>
        /// <exception cref="RefusedException">The protocol does not allow it.</exception>
        internal abstract void Check(object value);

        /// <summary>A checked value as it goes on the wire.</summary>
        internal abstract JsonValue Write(object value);

        /// <summary>What is expected, for error texts.</summary>
        internal abstract string Describe();

        internal RefusedException Refuse(JsonValue raw) { return new RefusedException("got " + raw.Show() + ", expected " + Describe()); }

        internal RefusedException Refuse(string received) { return new RefusedException("got " + received + ", expected " + Describe()); }
    }
}

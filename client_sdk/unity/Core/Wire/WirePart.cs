using System;

namespace Terraport.Wire
{
    /// <summary>
    /// A map of fields, as its table says: a message, or a map nested in one. Fields are read and set by their number in the table;
    /// integers pass as long, absent ones as null.
    /// </summary>
    public abstract class WirePart
    {
        /// <summary>The table: one static array a type, shared by all its instances.</summary>
        internal abstract Field[] Fields { get; }

        /// <summary>Value of a field by its number in <see cref="Fields"/>, as its kind takes it; null where it is absent.</summary>
        internal abstract object Get(int field);

        /// <summary>Set a field to a value that its kind has checked.</summary>
        internal abstract void Set(int field, object value);

        internal static Exception NoField(int field)
        {
            return new ArgumentOutOfRangeException("field", field, "expected a field of the table");
        }

        internal static T[] Parts<T>(object value)
            where T : WirePart { return value == null ? null : Array.ConvertAll((WirePart[])value, map => (T)map); }
    }
}
